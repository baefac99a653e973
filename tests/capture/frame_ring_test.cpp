// SPDX-License-Identifier: BSD-3-Clause
#include "capture/frame_ring.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <thread>

namespace throwcal {
namespace {

constexpr std::size_t slot_bytes = 64;

/// Writes a frame whose every byte is its number's.
bool write(FrameRing& ring, std::uint64_t number) {
  const auto slot = ring.lease();
  std::ranges::fill(slot, static_cast<std::uint8_t>(number));
  Frame frame;
  frame.sequence = number;
  frame.image.data = slot.data();
  return ring.publish(frame);
}

bool is_whole(const Frame& frame) {
  return std::all_of(frame.image.data, frame.image.data + slot_bytes, [&](std::uint8_t byte) {
    return byte == static_cast<std::uint8_t>(frame.sequence);
  });
}

TEST(FrameRing, GivesFramesInTheOrderTheyWerePublished) {
  FrameRing ring(3, slot_bytes);
  for (std::uint64_t n = 0; n < 20; ++n) {
    ASSERT_TRUE(write(ring, 2 * n));
    ASSERT_TRUE(write(ring, 2 * n + 1));
    EXPECT_EQ(ring.take()->frame().sequence, 2 * n);
    EXPECT_EQ(ring.take()->frame().sequence, 2 * n + 1);
  }
  EXPECT_EQ(ring.dropped(), 0u);
}

TEST(FrameRing, DropsAndCountsWhatFindsItFullAndKeepsTheRestWhole) {
  FrameRing ring(3, slot_bytes);
  for (std::uint64_t n = 0; n < 8; ++n) EXPECT_EQ(write(ring, n), n < 3);
  EXPECT_EQ(ring.dropped(), 5u);
  for (std::uint64_t n = 0; n < 3; ++n) {
    const auto lease = ring.take();
    EXPECT_EQ(lease->frame().sequence, n);
    EXPECT_TRUE(is_whole(lease->frame()));
  }
}

TEST(FrameRing, ALeasedFrameKeepsItsPixelsWhileOthersAreWritten) {
  FrameRing ring(2, slot_bytes);
  write(ring, 1);
  const auto lease = ring.take();
  for (std::uint64_t n = 2; n < 6; ++n) write(ring, n);
  EXPECT_TRUE(is_whole(lease->frame()));
  EXPECT_EQ(ring.dropped(), 3u) << "the leased slot is not free";
}

TEST(FrameRing, ClosedHandsOutWhatWaitsAndThenNothing) {
  FrameRing ring(2, slot_bytes);
  write(ring, 1);
  ring.close();
  EXPECT_FALSE(write(ring, 2));
  EXPECT_TRUE(ring.take());
  EXPECT_FALSE(ring.take());
  EXPECT_FALSE(ring.wait_for_room());
}

TEST(FrameRing, LosesNothingBetweenThreadsWhereTheWriterWaits) {
  constexpr std::uint64_t frames = 5000;
  FrameRing ring(4, slot_bytes);
  std::thread writer([&] {
    for (std::uint64_t n = 0; n < frames && ring.wait_for_room(); ++n) write(ring, n);
    ring.close();
  });
  std::uint64_t expected = 0, torn = 0;
  while (const auto lease = ring.take()) {
    EXPECT_EQ(lease->frame().sequence, expected++);
    torn += !is_whole(lease->frame());
  }
  writer.join();
  EXPECT_EQ(expected, frames);
  EXPECT_EQ(torn, 0u);
  EXPECT_EQ(ring.dropped(), 0u);
}

TEST(FrameRing, CountsEveryFrameOnceBetweenThreadsWhereTheWriterDoesNotWait) {
  constexpr std::uint64_t frames = 20000;
  FrameRing ring(4, slot_bytes);
  std::thread writer([&] {
    for (std::uint64_t n = 0; n < frames; ++n) write(ring, n);
    ring.close();
  });
  std::uint64_t taken = 0, torn = 0;
  while (const auto lease = ring.take()) {
    ++taken;
    torn += !is_whole(lease->frame());
  }
  writer.join();
  EXPECT_EQ(taken + ring.dropped(), frames);
  EXPECT_EQ(torn, 0u);
}

}  // namespace
}  // namespace throwcal
