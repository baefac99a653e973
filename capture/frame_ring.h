// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "capture/frame.h"

namespace throwcal {

class FrameRing;

/// A frame taken out of a ring: its pixels stay until this dies. Moves, never copies.
class FrameLease {
 public:
  FrameLease(FrameRing& ring, std::size_t slot) : ring_(&ring), slot_(slot) {}
  FrameLease(FrameLease&& other) noexcept
      : ring_(std::exchange(other.ring_, nullptr)), slot_(other.slot_) {}
  FrameLease& operator=(FrameLease&&) = delete;
  ~FrameLease();

  const Frame& frame() const;

 private:
  FrameRing* ring_;
  std::size_t slot_;
};

/// Where a grabbing thread hands frames to a detecting thread: lease a slot, write, publish; take,
/// read, release. One writer, one reader. All memory is taken at construction. The writer always
/// has a slot to write into, so a driver is never kept waiting by a slow reader; what finds the
/// ring full is dropped and counted.
class FrameRing {
 public:
  /// `frames`: how many may wait or be read at a time; one more slot is the writer's.
  FrameRing(std::size_t frames, std::size_t slot_bytes);

  /// The writer's slot; the same one again if what was written into it was not published.
  std::span<std::uint8_t> lease();
  /// Hands the writer's slot over. False: the ring was full, the frame is dropped and counted.
  bool publish(const Frame& frame);
  /// The oldest frame; waits for one. Nothing once the ring is closed and empty.
  std::optional<FrameLease> take();

  /// For a source that can wait: until publish() is sure to succeed. False: closed.
  bool wait_for_room();
  /// No more frames will come. Thread-safe.
  void close();
  /// Closes, and drops uncounted what nobody will read. Thread-safe.
  void abandon();

  std::uint64_t dropped() const;

 private:
  friend class FrameLease;
  void release(std::size_t slot);

  std::vector<std::uint8_t> memory_;
  std::size_t slot_bytes_;
  std::vector<Frame> frames_;
  std::vector<std::size_t> free_, waiting_;  ///< slots; waiting_ is a circular queue
  std::size_t first_waiting_ = 0, waiting_count_ = 0;
  std::size_t writers_;  ///< the writer's slot
  std::uint64_t dropped_ = 0;
  bool closed_ = false;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
};

}  // namespace throwcal
