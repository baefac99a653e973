// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/tar_file.h"

#include <gtest/gtest.h>

namespace throwcal {
namespace {

TEST(TarFile, IsHeadersContentAndTwoEmptyBlocks) {
  TarFile tar{std::chrono::system_clock::time_point(std::chrono::seconds(8))};
  tar.add("a/b.txt", "hello");
  tar.add("empty", "");
  const std::string bytes = std::move(tar).finish();
  ASSERT_EQ(bytes.size(), 512u * (2 + 1 + 2));
  EXPECT_STREQ(bytes.c_str(), "a/b.txt");
  EXPECT_EQ(bytes.substr(124, 12), std::string("00000000005\0", 12));
  EXPECT_EQ(bytes.substr(136, 12), std::string("00000000010\0", 12));
  EXPECT_EQ(bytes.substr(257, 8), std::string("ustar\0"
                                              "00",
                                              8));
  EXPECT_EQ(bytes.substr(512, 6), std::string("hello\0", 6));
  EXPECT_STREQ(bytes.c_str() + 1024, "empty");
  EXPECT_EQ(bytes.substr(1536), std::string(1024, '\0'));
}

TEST(TarFile, TheChecksumIsTheSumOfTheHeaderWithBlanksInItsPlace) {
  TarFile tar{std::chrono::system_clock::time_point{}};
  tar.add(std::string(100, '\xff'), std::string(512, 'x'));
  std::string header = std::move(tar).finish().substr(0, 512);
  const unsigned long told = std::stoul(header.substr(148, 6), nullptr, 8);
  header.replace(148, 8, 8, ' ');
  unsigned long sum = 0;
  for (const char c : header) sum += static_cast<unsigned char>(c);
  EXPECT_EQ(told, sum);
}

}  // namespace
}  // namespace throwcal
