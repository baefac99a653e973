// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/text_file.h"

#include <gtest/gtest.h>

#include "firmware/input_error.h"

#include "tests/support/temporary_folder.h"

namespace throwcal {
namespace {

class TextFileTest : public testing::Test {
 protected:
  const test::TemporaryFolder temporary_;
  const std::filesystem::path& folder_ = temporary_.path();
};

TEST_F(TextFileTest, IsReplacedAsAWholeAndLeavesNothingBeside) {
  const auto file = folder_ / "a.json";
  write_text_file(file, "one");
  write_text_file(file, "two");
  EXPECT_EQ(read_text_file(file), "two");
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder_), {}), 1);
}

TEST_F(TextFileTest, SaysWhichFileAndWhy) {
  const auto message = [](const auto& work) -> std::string {
    try {
      work();
    } catch (const InputError& error) {
      return error.what();
    }
    return "no error";
  };
  const auto missing = folder_ / "no" / "file";
  EXPECT_EQ(message([&] { read_text_file(missing); }),
            missing.string() + ": can't be opened: No such file or directory");
  EXPECT_EQ(message([&] { read_text_file(folder_); }),
            folder_.string() + ": can't be read: Is a directory");
  EXPECT_EQ(message([&] { write_text_file(missing, "x"); }),
            missing.string() + ": can't be written: No such file or directory");
}

TEST_F(TextFileTest, ADeviceIsWrittenToNotReplaced) {
  write_text_file("/dev/null", "x");
  EXPECT_TRUE(std::filesystem::is_character_file("/dev/null"));
}

TEST(Shortest, ReadsBackAsTheSameNumber) {
  EXPECT_EQ(shortest(0.1), "0.1");
  EXPECT_EQ(shortest(9.80665), "9.80665");
  EXPECT_EQ(shortest(-900.0), "-900");
}

}  // namespace
}  // namespace throwcal
