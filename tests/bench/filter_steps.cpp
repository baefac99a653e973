// SPDX-License-Identifier: BSD-3-Clause
// filter_steps CAMERAS [offsets] [drag]: a thousand predict + update of the RB-EKF, for counting
// their instructions under valgrind --tool=callgrind --toggle-collect=*measured*.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "estimator/ekf.h"
#include "tests/bench/measured.h"
#include "tests/support/true_solution.h"

using namespace throwcal;

int main(int argc, char** argv) {
  constexpr int steps = 1000;
  const std::vector<std::string> words(argv + 1, argv + argc);
  const auto has = [&](const char* word) {
    return std::find(words.begin(), words.end(), word) != words.end();
  };
  if (words.empty() || std::atoi(words[0].c_str()) < 2) {
    std::fputs("usage: filter_steps CAMERAS [offsets] [drag]\n", stderr);
    return 2;
  }
  const test::Thrown thrown = test::make_thrown({.cameras = std::atoi(words[0].c_str()),
                                                 .throws = 1,
                                                 .max_offset_s = has("offsets") ? 0.01 : 0.0,
                                                 .drag_per_m = has("drag") ? 0.0175 : 0.0,
                                                 .estimate_drag = has("drag")});
  const auto timed = time_throws(thrown.rig, thrown.throws);
  const Solution truth = test::true_solution(thrown, timed);
  Ekf filter(thrown.rig, truth.rig, {});
  filter.start_throw(truth.balls[0]);
  const auto& sightings = timed[0].sightings;
  bench::measured([&] {
    for (int i = 0; i < steps; ++i) {  // forward and backward, as the RB-EKF does
      const std::size_t n = sightings.size(), turn = static_cast<std::size_t>(i) % (2 * n);
      filter.update(sightings[turn < n ? turn : 2 * n - 1 - turn]);
    }
  });
  std::printf("%d\n", steps);
}
