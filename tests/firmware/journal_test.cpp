// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/journal.h"

#include <gtest/gtest.h>

namespace throwcal {
namespace {

using Fields = std::vector<std::string>;

TEST(Journal, AnEntryHasWhatIsKnown) {
  EXPECT_EQ(journal_fields("hello", {}),
            (Fields{"MESSAGE=hello", "PRIORITY=6", "SYSLOG_IDENTIFIER=throwcald"}));
  EXPECT_EQ(
      journal_fields("camera \"north\": was unplugged",
                     {.priority = 4, .session = 7, .cause = "camera north", .message_id = "d3fa"}),
      (Fields{"MESSAGE=camera \"north\": was unplugged", "PRIORITY=4",
              "SYSLOG_IDENTIFIER=throwcald", "THROWCAL_SESSION=7", "THROWCAL_CAMERA=north",
              "THROWCAL_CAUSE=camera north", "MESSAGE_ID=d3fa"}));
}

TEST(Journal, ElsewhereLinesHaveTheirMarks) {
  testing::internal::CaptureStderr();
  log_info("one\nforged <3>line");
  log_warning("two");
  log_error("three");
  log_info(Happening::session_began, "four");
  LogOnce once;
  once.warning("store", "five");
  once.warning("store", "five");
  EXPECT_EQ(testing::internal::GetCapturedStderr(),
            "<6>one forged <3>line\n<4>two\n<3>three\n<6>four\n<4>five\n");
}

TEST(Journal, RemembersItsLastLines) {
  log_warning("a line\nthat is " + std::string(1000, 'x'));
  const std::string first = recent_log_lines().back();
  EXPECT_EQ(first.size(), 500u);
  EXPECT_EQ(first.substr(19, 27), "Z warning: a line that is x") << first;
  for (int i = 0; i < 600; ++i) log_info("line " + std::to_string(i));
  const auto lines = recent_log_lines();
  ASSERT_EQ(lines.size(), 500u);
  EXPECT_TRUE(lines.front().ends_with("Z info: line 100")) << lines.front();
  EXPECT_TRUE(lines.back().ends_with("Z info: line 599")) << lines.back();
}

}  // namespace
}  // namespace throwcal
