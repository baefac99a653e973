// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <string>
#include <vector>

#include "estimator/super_state.h"
#include "estimator/throw_set.h"
#include "tests/support/thrower.h"

namespace throwcal::bench {

/// A recording and where every contender starts: at the closed form's solution.
struct Case {
  std::string name;
  test::Thrown thrown;
  std::vector<TimedThrow> throws;
  Solution start;
};

/// 4 cameras x 10 throws x 54 frames with 0.2 px of stated noise; `free_running`: every camera has
/// its own clock, and the ball has drag, both estimated.
Case four_cameras(bool free_running);

/// The thesis' two cameras (366 x 234 px, f 278 and 298 px), 30 frames of each a throw,
/// synchronised, 4 m from where the ball flies and at a right angle.
test::Thrown thesis_rig(std::uint64_t seed, int throws, double sigma_px);

}  // namespace throwcal::bench
