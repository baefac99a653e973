// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <optional>
#include <stop_token>
#include <vector>

#include "estimator/observation.h"

namespace throwcal {

/// Where the cameras' threads hand their sightings to the estimator's. Bounded; counts what it
/// drops. Thread-safe.
class SightingQueue {
 public:
  SightingQueue(std::size_t frames, int writers);

  /// Full: the frame is dropped and counted, or, where `may_wait`, waits for room.
  void push(FrameSightings frame, bool may_wait);
  /// The oldest. Waits for one; nothing when `stop` is requested or all writers are done and all is
  /// handed out.
  std::optional<FrameSightings> pop(std::stop_token stop);
  void writer_done();
  /// No one waits any more to push; what does not fit is dropped.
  void close();
  std::uint64_t dropped() const;

 private:
  std::vector<FrameSightings> frames_;  ///< a circular queue
  std::size_t first_ = 0, count_ = 0;
  int writers_;
  bool closed_ = false;
  std::uint64_t dropped_ = 0;
  mutable std::mutex mutex_;
  std::condition_variable_any changed_;
};

}  // namespace throwcal
