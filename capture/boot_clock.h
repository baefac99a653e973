// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <chrono>
#include <cstdint>

#include "estimator/time.h"

namespace throwcal {

/// A moment on CLOCK_BOOTTIME as one on CLOCK_MONOTONIC, `suspended` being what the former is ahead
/// by: the time that this machine slept. libcamera promises the former, and its pipelines hand on
/// V4L2's stamps, which are the latter: of the two readings the one nearer to `about` is meant.
inline HostTime from_boot_time(std::int64_t stamp_ns, std::chrono::nanoseconds suspended,
                               HostTime about) {
  const HostTime as_it_is{std::chrono::nanoseconds(stamp_ns)};
  const HostTime shifted = as_it_is - suspended;
  return std::chrono::abs(shifted - about) <= std::chrono::abs(as_it_is - about) ? shifted
                                                                                 : as_it_is;
}

/// What CLOCK_BOOTTIME is ahead of CLOCK_MONOTONIC by. It changes only while the machine sleeps,
/// but each reading is off by what passed between the two: the first stands until another is far
/// off.
class BootClock {
 public:
  std::chrono::nanoseconds suspended();

 private:
  std::chrono::nanoseconds suspended_{};
};

}  // namespace throwcal
