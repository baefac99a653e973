// SPDX-License-Identifier: BSD-3-Clause
#include "capture/boot_clock.h"

#include <ctime>

namespace throwcal {
namespace {

using std::chrono::nanoseconds;

/// No machine sleeps and wakes in less; no reading is off by as much, but for one that was
/// interrupted.
constexpr std::chrono::milliseconds least{5};
constexpr int readings = 5;

nanoseconds read(clockid_t clock) {
  timespec time{};
  clock_gettime(clock, &time);
  return std::chrono::seconds(time.tv_sec) + nanoseconds(time.tv_nsec);
}

/// The best of some readings: CLOCK_BOOTTIME between two of CLOCK_MONOTONIC.
nanoseconds measure() {
  nanoseconds best{}, narrowest = nanoseconds::max();
  for (int i = 0; i < readings; ++i) {
    const nanoseconds before = read(CLOCK_MONOTONIC), boot = read(CLOCK_BOOTTIME),
                      after = read(CLOCK_MONOTONIC);
    if (after - before >= narrowest) continue;
    narrowest = after - before;
    best = boot - before - narrowest / 2;
  }
  return best;
}

}  // namespace

nanoseconds BootClock::suspended() {
  const nanoseconds ahead = read(CLOCK_BOOTTIME) - read(CLOCK_MONOTONIC);
  if (std::chrono::abs(ahead - suspended_) < least) return suspended_;
  const nanoseconds measured = measure();
  if (std::chrono::abs(measured - suspended_) >= least) suspended_ = measured;
  return suspended_;
}

}  // namespace throwcal
