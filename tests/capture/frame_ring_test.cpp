// SPDX-License-Identifier: BSD-3-Clause
#include "capture/frame_ring.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <thread>
#include <vector>

namespace throwcal {
namespace {

constexpr std::size_t slot_bytes = 64;

/// Writes a frame whose every byte is its number's.
bool write(FrameRing& ring, std::uint64_t number) {
  const auto slot = ring.lease();
  std::ranges::fill(slot, static_cast<std::uint8_t>(number));
  Frame frame;
  frame.sequence = number;
  frame.row0_mid_exposure = HostTime(HostClock::duration(number));
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

TEST(FrameRing, KeepsTheLastFramesThatWereReadUntilTheirSlotsAreNeeded) {
  FrameRing ring(5, slot_bytes);
  for (std::uint64_t n = 0; n < 20; ++n) {
    write(ring, n);
    ring.take();
  }
  const auto kept = ring.freeze(HostTime(HostClock::duration(17)));
  ASSERT_EQ(kept.size(), 3u);
  for (std::uint64_t n = 0; n < 3; ++n) EXPECT_EQ(kept[n].frame().sequence, 17 + n);
  EXPECT_EQ(ring.freeze({}).size(), 5u) << "all that there is room for";
}

TEST(FrameRing, WhatIsFrozenStaysWhileFramesGoOnThroughTheOtherSlots) {
  FrameRing ring(6, slot_bytes);
  for (std::uint64_t n = 0; n < 6; ++n) {
    write(ring, n);
    ring.take();
  }
  auto frozen = ring.freeze(HostTime(HostClock::duration(2)));
  for (std::uint64_t n = 6; n < 40; ++n) {
    ASSERT_TRUE(write(ring, n));
    EXPECT_EQ(ring.take()->frame().sequence, n);
  }
  for (std::uint64_t n = 2; n < 6; ++n) {
    EXPECT_EQ(frozen[n - 2].frame().sequence, n);
    EXPECT_TRUE(is_whole(frozen[n - 2].frame()));
  }
  frozen.clear();
  for (std::uint64_t n = 40; n < 46; ++n) EXPECT_TRUE(write(ring, n)) << "its slots are free again";
  EXPECT_EQ(ring.dropped(), 0u);
}

TEST(FrameRing, FrozenAltogetherItDropsAndCounts) {
  FrameRing ring(3, slot_bytes);
  for (std::uint64_t n = 0; n < 3; ++n) write(ring, n);
  const auto frozen = ring.freeze({});
  EXPECT_EQ(frozen.size(), 3u) << "frames that nobody took yet, too";
  while (ring.dropped() == 0) write(ring, 9);
  EXPECT_EQ(ring.take()->frame().sequence, 0u) << "frozen is not taken";
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

/// What a box may do at once: a detector, its helpers, whoever saves the last seconds, previews.
TEST(FrameRing, EightReadersSeeEveryFrameOnceAndWholeWhileOthersFreezeIt) {
  constexpr std::uint64_t frames = 4000;
  constexpr int takers = 4, freezers = 4;
  FrameRing ring(16, slot_bytes);
  std::vector<std::atomic<int>> times_taken(frames);
  std::atomic<std::uint64_t> torn = 0, out_of_order = 0;
  std::atomic<bool> is_over = false;
  std::vector<std::thread> readers;
  for (int i = 0; i < takers; ++i)
    readers.emplace_back([&] {
      while (const auto lease = ring.take()) {
        ++times_taken[lease->frame().sequence];
        torn += !is_whole(lease->frame());
      }
    });
  for (int i = 0; i < freezers; ++i)
    readers.emplace_back([&] {
      std::uint64_t last = 0;
      while (!is_over) {
        const auto frozen = ring.freeze(HostTime(HostClock::duration(last)));
        for (const FrameLease& lease : frozen) {
          out_of_order += lease.frame().sequence < last;
          last = lease.frame().sequence;
          torn += !is_whole(lease.frame());
        }
      }
    });
  for (std::uint64_t n = 0; n < frames && ring.wait_for_room(); ++n) write(ring, n);
  ring.close();
  for (int i = 0; i < takers; ++i) readers[static_cast<std::size_t>(i)].join();
  is_over = true;
  for (int i = takers; i < takers + freezers; ++i) readers[static_cast<std::size_t>(i)].join();
  EXPECT_EQ(torn, 0u);
  EXPECT_EQ(out_of_order, 0u);
  // A freezer may take the room between the wait and the writing: then the frame counts as dropped.
  const auto once =
      std::ranges::count_if(times_taken, [](const auto& times) { return times == 1; });
  EXPECT_EQ(static_cast<std::uint64_t>(once) + ring.dropped(), frames);
}

}  // namespace
}  // namespace throwcal
