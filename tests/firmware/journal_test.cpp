// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/journal.h"

#include <gtest/gtest.h>

namespace throwcal {
namespace {

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
