// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "capture/frame.h"

namespace throwcal {

/// What a driver and the kernel say of when a frame was taken.
struct DriverStamp {
  std::optional<HostTime>
      stamp;  ///< on CLOCK_MONOTONIC; nothing where the driver's clock is another
  TimestampSource source = TimestampSource::unknown;  ///< of `stamp`
  HostTime dequeued{};                                ///< when the frame was taken from the driver
  std::uint64_t sequence = 0;
};

/// From a driver's stamps to the middle of the exposure of row 0, with its 1-sigma. Stamps are kept
/// to the nanosecond; what is seconds off is on another clock and gives way to the time of
/// dequeueing, and says so. A dequeued frame is late by what the kernel and the scheduler took,
/// never early: such times follow the earliest that a regular camera's frames can have been.
class FrameClock {
 public:
  /// `interval_s`: of the frames, 0 if unknown. `readout_s`: from the first row's end of exposure
  /// to the last's; 0 for a global shutter.
  FrameClock(double interval_s, double exposure_s, double readout_s);

  struct Moment {
    HostTime row0_mid_exposure{};
    std::chrono::nanoseconds sigma{};
    TimestampSource source = TimestampSource::unknown;
  };
  Moment of(const DriverStamp& stamp);
  /// Of the frames from now on, where a driver tells it.
  void set_exposure(double exposure_s) { exposure_s_ = exposure_s; }

 private:
  void measure(HostTime time, std::uint64_t sequence);
  HostTime earliest(HostTime dequeued, std::uint64_t sequence);

  double interval_s_, exposure_s_, readout_s_;
  struct Taken {
    HostTime time{};
    std::uint64_t sequence = 0;
  };
  std::array<Taken, 64> window_{};  ///< circular: frames dequeued last
  std::size_t taken_ = 0;
  std::optional<HostTime> last_;
  std::uint64_t last_sequence_ = 0;
  double mean_interval_s_ = 0.0, jitter_s2_ = 0.0;
  std::uint64_t measured_ = 0;
};

}  // namespace throwcal
