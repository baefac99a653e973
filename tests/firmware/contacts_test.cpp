// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/contacts.h"

#include <gtest/gtest.h>

namespace throwcal {
namespace {

using namespace std::chrono_literals;

/// Whether a contact that is found down by Contacts made now may become a factory reset.
bool may_reset(Button::Time started) {
  EventLoop loop;
  ButtonTimes times;
  times.boot = 1h;  // this machine may be slow
  Contacts contacts(
      loop, times, started, [] {}, [](Press) {});
  contacts.add("key", true);
  return contacts.is_held();
}

TEST(Contacts, OneThatIsDownSinceTheStartMayReset) { EXPECT_TRUE(may_reset(Button::Clock::now())); }

/// As after a reload: a stuck button must not take the token away.
TEST(Contacts, MadeAnewLaterTheyDoNotTakeAStuckOneForThat) {
  EXPECT_FALSE(may_reset(Button::Clock::now() - 2h));
}

}  // namespace
}  // namespace throwcal
