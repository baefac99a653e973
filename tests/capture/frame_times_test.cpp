// SPDX-License-Identifier: BSD-3-Clause
#include "capture/frame_times.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <stdexcept>

namespace throwcal {
namespace {

class FrameTimes : public testing::Test {
 protected:
  std::string path_ = (std::filesystem::path(testing::TempDir()) /
                       (std::string(testing::UnitTest::GetInstance()->current_test_info()->name()) +
                        ".timestamps.txt"))
                          .string();
  ~FrameTimes() override { std::filesystem::remove(path_); }

  std::vector<std::int64_t> read(const std::string& text) {
    std::ofstream(path_) << text;
    std::vector<std::int64_t> ns;
    for (const HostTime time : read_frame_times(path_))
      ns.push_back(time.time_since_epoch().count());
    return ns;
  }
  std::string error_of(const std::string& text) {
    try {
      read(text);
    } catch (const std::runtime_error& e) {
      return e.what();
    }
    return "none";
  }
};

TEST_F(FrameTimes, AreExactToTheNanosecond) {
  const std::vector<std::int64_t> expected{-500000, 0, 16683333, 33366667, 1700000000123456789};
  EXPECT_EQ(
      read(
          "# timestamp format v2\n-0.5\n0\n16.683333\n 33.3666666667 \r\n\n1700000000123.456789\n"),
      expected);
}

TEST_F(FrameTimes, SayWhichLineIsNoTime) {
  EXPECT_EQ(error_of("# timestamp format v2\n0.0\n16,7\n"),
            path_ + ", line 3: \"16,7\" is no time; expected milliseconds such as 16.683333");
  for (const char* bad :
       {"abc", "1.2.3", "1e3", "nan", "-", ".", "9999999999999", "4000000000001", "1 2", "0x10"})
    EXPECT_NE(error_of(std::string(bad) + "\n").find(", line 1: "), std::string::npos) << bad;
}

TEST_F(FrameTimes, SayItOnOneLineWhateverTheBytes) {
  EXPECT_EQ(error_of(std::string("0\n\x1b[2J\0\xff", 8)),
            path_ +
                ", line 2: \"\\x1B[2J\\x00\\xFF\" is no time; expected milliseconds such as "
                "16.683333");
  EXPECT_LT(error_of(std::string(100'000, 'x')).size(), path_.size() + 200);
}

TEST_F(FrameTimes, MayHaveMoreDecimalsThanCount) {
  EXPECT_EQ(read("0.00000049999999999999999999999999\n1.9999999999999999999999999999\n"),
            (std::vector<std::int64_t>{0, 2'000'000}));
}

TEST_F(FrameTimes, SayWhichLineDoesNotAscend) {
  EXPECT_EQ(error_of("0\n10\n10.000000\n"),
            path_ + ", line 3: 10.000000 ms is not after the frame before it; times must ascend");
}

TEST_F(FrameTimes, SayWhichFileIsMissing) {
  try {
    read_frame_times("nowhere/north.timestamps.txt");
    FAIL() << "read a file that is not there";
  } catch (const std::runtime_error& e) {
    EXPECT_EQ(std::string(e.what()),
              "nowhere/north.timestamps.txt: cannot be opened; frame times were expected there");
  }
}

}  // namespace
}  // namespace throwcal
