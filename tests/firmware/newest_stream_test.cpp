// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/newest_stream.h"

#include <gtest/gtest.h>

namespace throwcal {
namespace {

const NewestStream::Clock::time_point some_time{std::chrono::seconds(5)};

NewestStream::Message text(const char* t) { return std::make_shared<const std::string>(t); }

std::string read(NewestStream& stream, std::size_t most) {
  std::string out(most, '\0');
  out.resize(stream.read(out));
  return out;
}

TEST(NewestStream, ASlowReaderMissesMessagesNotPartsOfThem) {
  NewestStream stream(some_time);
  EXPECT_EQ(read(stream, 10), "");
  stream.offer(text("first."), some_time);
  EXPECT_EQ(read(stream, 4), "firs");
  stream.offer(text("second."), some_time);
  stream.offer(text("third."), some_time);
  EXPECT_FALSE(stream.is_empty());
  EXPECT_EQ(read(stream, 1), "t");
  EXPECT_EQ(read(stream, 100), ".third.");
  EXPECT_TRUE(stream.is_empty());
  EXPECT_EQ(read(stream, 100), "");
}

TEST(NewestStream, AMessageOfNoBytesIsNone) {
  NewestStream stream(some_time);
  stream.offer(text(""), some_time);
  EXPECT_EQ(read(stream, 10), "");
  EXPECT_TRUE(stream.is_empty());
}

}  // namespace
}  // namespace throwcal
