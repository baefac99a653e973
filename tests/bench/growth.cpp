// SPDX-License-Identifier: BSD-3-Clause
// growth CAMERAS THROWS: the whole method from nothing, free-running cameras, offsets and drag
// estimated. Prints one row "cameras,throws,sightings,seconds,MB before,MB at most": processor
// time, the median of a few runs, and resident memory, so every point wants a process of its own.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <vector>

#include "estimator/calibrate.h"
#include "tests/bench/measured.h"
#include "tests/support/thrower.h"

using namespace throwcal;

namespace {

double processor_s() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

}  // namespace

int main(int argc, char** argv) {
  const int cameras = argc == 3 ? std::atoi(argv[1]) : 0,
            throws = argc == 3 ? std::atoi(argv[2]) : 0;
  if (cameras < 2 || throws < 1) {
    std::fputs("usage: growth CAMERAS THROWS\n", stderr);
    return 2;
  }
  const test::Thrown thrown = test::make_thrown({.cameras = cameras,
                                                 .throws = throws,
                                                 .side_m = 8.0,
                                                 .max_offset_s = 0.015,
                                                 .drag_per_m = 0.0175,
                                                 .estimate_drag = true});
  std::size_t sightings = 0;
  for (const Throw& one : thrown.throws)
    for (const Track& track : one.tracks) sightings += track.sightings.size();

  constexpr double enough_s = 0.5;
  bench::forget_most_resident();
  const double before_mb = bench::resident_mb("VmRSS:");
  std::vector<double> took_s;
  for (double all_s = 0.0; took_s.empty() || (took_s.size() < 25 && all_s < enough_s);) {
    const double start_s = processor_s();
    const Calibration result = calibrate(thrown.rig, thrown.throws);
    took_s.push_back(processor_s() - start_s);
    all_s += took_s.back();
    if (result.verdict != Verdict::accepted && result.verdict != Verdict::needs_more_throws) {
      std::fprintf(stderr, "growth: %s\n", result.reasons.at(0).c_str());
      return 1;
    }
  }
  std::nth_element(took_s.begin(), took_s.begin() + took_s.size() / 2, took_s.end());
  std::printf("%d,%d,%zu,%.5f,%.1f,%.1f\n", cameras, throws, sightings, took_s[took_s.size() / 2],
              before_mb, bench::resident_mb("VmHWM:"));
}
