// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <chrono>
#include <cstdint>

namespace throwcal {

/// The one clock of the code: CLOCK_MONOTONIC of the box (or, offline, the recording's own times),
/// integer nanoseconds. It has no now() here: the estimator never reads a clock, capture/ does.
struct HostClock {
  using duration = std::chrono::nanoseconds;
  using rep = duration::rep;
  using period = duration::period;
  using time_point = std::chrono::time_point<HostClock>;
  static constexpr bool is_steady = true;
};
using HostTime = HostClock::time_point;

/// Difference in seconds; only ever used within a throw or a session, where a double keeps it to
/// picoseconds.
inline double seconds(HostClock::duration d) { return std::chrono::duration<double>(d).count(); }

/// Rounds to the nearest nanosecond (8 m/s x 0.5 ns = 4 nm).
inline HostClock::duration from_seconds(double s) {
  return HostClock::duration(static_cast<std::int64_t>(s * 1e9 + (s < 0 ? -0.5 : 0.5)));
}

}  // namespace throwcal
