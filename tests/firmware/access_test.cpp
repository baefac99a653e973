// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/access.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>

#include "firmware/input_error.h"
#include "firmware/sha256.h"
#include "firmware/text_file.h"

namespace throwcal {
namespace {

using namespace std::chrono_literals;

class TokenFile : public testing::Test {
 protected:
  ~TokenFile() override { std::filesystem::remove_all(folder_); }

  const std::filesystem::path folder_ =
      std::filesystem::path(testing::TempDir()) /
      ("token" + std::to_string(testing::UnitTest::GetInstance()->random_seed()) +
       testing::UnitTest::GetInstance()->current_test_info()->name());
  const std::filesystem::path file_ = folder_ / "token";

  void SetUp() override { std::filesystem::create_directories(folder_); }
};

TEST(Sha256, IsThatOfTheStandard) {
  EXPECT_EQ(sha256_hex("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

TEST(Access, KnowsItsTokenOnly) {
  const Access access("correct-horse");
  EXPECT_TRUE(access.knows("correct-horse"));
  for (const char* wrong : {"", "correct-hors", "correct-horse ", "Correct-horse"})
    EXPECT_FALSE(access.knows(wrong)) << wrong;
}

TEST(Access, HasAShortKeyForCan) {
  EXPECT_EQ(Access("abc").short_key(), 0xba7816bf) << "the first bytes of FIPS 180-4's example";
}

TEST(Access, IsOpenForAMinuteAfterAPress) {
  Access access("correct-horse");
  const Access::Clock::time_point pressed(100s);
  EXPECT_FALSE(access.is_open(pressed));
  access.button_pressed(pressed);
  EXPECT_TRUE(access.is_open(pressed));
  EXPECT_TRUE(access.is_open(pressed + 59s));
  EXPECT_FALSE(access.is_open(pressed + 60s));
}

TEST_F(TokenFile, IsMadeOnceAndStays) {
  const std::string token = token_in(file_);
  EXPECT_EQ(token.size(), 32u);
  EXPECT_EQ(token_in(file_), token);
  struct stat facts {};
  ASSERT_EQ(stat(file_.c_str(), &facts), 0);
  EXPECT_EQ(facts.st_mode & 0007, 0u) << "others must not read it";
  std::filesystem::remove(file_);
  EXPECT_NE(token_in(file_), token);
}

TEST_F(TokenFile, AReplacedOneIsAnother) {
  const std::string old = token_in(file_);
  const std::string made = new_token_in(file_);
  EXPECT_NE(made, old);
  EXPECT_EQ(token_in(file_), made);
  Access access(old);
  access.renew(made);
  EXPECT_TRUE(access.knows(made));
  EXPECT_FALSE(access.knows(old));
  EXPECT_THROW(new_token_in(folder_ / "nowhere" / "token"), InputError);
}

TEST_F(TokenFile, MayBeOnesOwn) {
  write_text_file(file_, "my-own-secret\r\na second line\n");
  EXPECT_EQ(token_in(file_), "my-own-secret");
}

TEST_F(TokenFile, IsRefusedWhereItIsNone) {
  for (const std::string& bad :
       {std::string("short\n"), std::string("\n"), std::string(), std::string("with a space"),
        std::string(129, 'x'), std::string("bell\a-bell-bell")}) {
    write_text_file(file_, bad);
    try {
      token_in(file_);
      ADD_FAILURE() << bad;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find("token:1: expected"), std::string::npos)
          << error.what();
    }
  }
  EXPECT_THROW(token_in(folder_), InputError);
  EXPECT_THROW(token_in(folder_ / "nowhere" / "token"), InputError);
}

}  // namespace
}  // namespace throwcal
