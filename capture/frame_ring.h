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

/// A frame of a ring, by reference: its pixels stay until this dies. Moves, never copies.
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

/// Where a grabbing thread hands frames to those who look at them: lease a slot, write, publish;
/// take, read, release. One writer; any number of threads may read. A frame that was taken and
/// released stays until its slot is needed, the oldest going first: so the ring also holds the last
/// seconds, and freeze() keeps them. All memory is taken at construction. The writer always has a
/// slot to write into, so a driver is never kept waiting by a slow reader; what finds every slot
/// waiting or held is dropped and counted.
class FrameRing {
 public:
  /// `frames`: how many may wait, be read or be kept at a time; one more slot is the writer's.
  FrameRing(std::size_t frames, std::size_t slot_bytes);

  /// The writer's slot; the same one again if what was written into it was not published.
  std::span<std::uint8_t> lease();
  /// Hands the writer's slot over. False: the ring was full, the frame is dropped and counted.
  bool publish(const Frame& frame);
  /// The oldest frame that nobody took yet; waits for one. Nothing once the ring is closed and all
  /// are taken.
  std::optional<FrameLease> take();
  /// Every frame since then that is still here, taken or not, oldest first. The writer goes on with
  /// the slots that are left.
  std::vector<FrameLease> freeze(HostTime since);

  /// The newest frame, taken or not; nothing where there was none yet.
  std::optional<FrameLease> newest();

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
  std::optional<std::size_t> oldest_unheld() const;

  std::vector<std::uint8_t> memory_;
  std::size_t slot_bytes_;
  std::vector<Frame> frames_;
  std::vector<int> holders_;           ///< of each slot: leases that live
  std::vector<std::size_t> unused_;    ///< slots that never held a frame
  std::vector<std::size_t> in_order_;  ///< slots with frames, oldest first
  std::size_t taken_ = 0;              ///< so many of them, the oldest, were taken
  std::size_t writers_;                ///< the writer's slot
  std::uint64_t dropped_ = 0;
  bool closed_ = false;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
};

}  // namespace throwcal
