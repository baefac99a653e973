// SPDX-License-Identifier: BSD-3-Clause
#include "capture/quotation.h"

#include <gtest/gtest.h>

namespace throwcal {
namespace {

TEST(Quotation, IsOneShortLineOfPrintableText) {
  EXPECT_EQ(in_quotes("12,5"), "\"12,5\"");
  EXPECT_EQ(in_quotes(""), "\"\"");
  EXPECT_EQ(in_quotes(std::string("a\0b\n\xC3\xA4", 6)), "\"a\\x00b\\x0A\\xC3\\xA4\"");
  EXPECT_EQ(printable(std::string(40, 'x')), std::string(40, 'x'));
  EXPECT_EQ(printable(std::string(41, 'x')).size(), 43u);
  EXPECT_TRUE(printable(std::string(41, 'x')).ends_with("x..."));
}

}  // namespace
}  // namespace throwcal
