// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <fstream>
#include <string>

namespace throwcal::bench {

/// A name that callgrind's --toggle-collect finds: only what runs inside is counted.
template <typename Work>
__attribute__((noinline)) void measured(Work work) {
  work();
}

/// Resident memory now ("VmRSS:") or at its most ("VmHWM:") [MB]. (getrusage's most is a parent's
/// too, for a process inherits it.)
inline double resident_mb(const std::string& which) {
  std::ifstream status("/proc/self/status");
  double kilobytes = 0.0;
  for (std::string word; status >> word;)
    if (word == which) status >> kilobytes;
  return kilobytes / 1024.0;
}

/// From here on "VmHWM:" begins anew.
inline void forget_most_resident() { std::ofstream("/proc/self/clear_refs") << "5"; }

}  // namespace throwcal::bench
