// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/throw_iteration.h"

#include <gtest/gtest.h>

#include "estimator/refinement.h"
#include "tests/support/true_solution.h"

namespace throwcal {
namespace {

using test::make_thrown;
using test::Thrown;

double rms_rotation(const Thrown& thrown, const RigState& rig) {
  double sum = 0;
  for (std::size_t k = 0; k < rig.cameras(); ++k)
    sum += test::pose_error(thrown, rig, k).tail<3>().squaredNorm();
  return std::sqrt(sum / static_cast<double>(rig.cameras()));
}

TEST(ThrowIteration, RbEkfAloneComesCloseToTheRefinementFromARoughStart) {
  double filter = 0, refined = 0;
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    const Thrown thrown = make_thrown({.seed = seed, .throws = 3});
    const auto timed = time_throws(thrown.rig, thrown.throws);
    const Solution start =
        test::rough_start(test::true_solution(thrown, timed), 0.2, 0.3, 0.6, seed);
    const Solution at =
        iterate_throws(thrown.rig, timed, start, Method::rb_ekf, {.ekf = {}, .sweeps = 10});
    filter += std::pow(rms_rotation(thrown, at.rig), 2);
    refined += std::pow(rms_rotation(thrown, refine(thrown.rig, timed, at).solution.rig), 2);
  }
  EXPECT_LT(std::sqrt(filter / refined), 1.2);
}

TEST(ThrowIteration, RbEkfFindsClockOffsetsAndDragToo) {
  const Thrown thrown = make_thrown(
      {.throws = 5, .max_offset_s = 0.015, .drag_per_m = 0.0175, .estimate_drag = true});
  const auto timed = time_throws(thrown.rig, thrown.throws);
  const Solution start = test::rough_start(test::true_solution(thrown, timed), 0.05, 0.1, 0.3, 4);
  const Solution at =
      iterate_throws(thrown.rig, timed, start, Method::rb_ekf, {.ekf = {}, .sweeps = 15});
  for (std::size_t k = 1; k < 4; ++k)
    EXPECT_NEAR(at.rig.time_offset_s[k], thrown.time_offset_s[k], 5e-4);
  EXPECT_NEAR(at.rig.drag_per_m, 0.0175, 0.004);
}

TEST(ThrowIteration, AFilterStartedAtTheTruthWithoutNoiseStaysThere) {
  const Thrown thrown = make_thrown({.throws = 2, .sigma_px = 1e-9, .state_sigma = false});
  const auto timed = time_throws(thrown.rig, thrown.throws);
  for (Method method : {Method::ekf, Method::r_ekf, Method::rb_ekf})
    EXPECT_LT(
        rms_rotation(
            thrown,
            iterate_throws(thrown.rig, timed, test::true_solution(thrown, timed), method).rig),
        1e-7);
}

TEST(ThrowIteration, CameraOneKeepsItsPlaceHeadingAndClock) {
  const Thrown thrown = make_thrown({.max_offset_s = 0.01});
  const auto timed = time_throws(thrown.rig, thrown.throws);
  const Solution start = test::rough_start(test::true_solution(thrown, timed), 0.1, 0.2, 0.3, 4);
  const Rigid at = iterate_throws(thrown.rig, timed, start, Method::rb_ekf).rig.T_world_cam[0];
  EXPECT_EQ(at.translation.norm(), 0.0);
  EXPECT_NEAR(at.rotation(1, 2), 0.0, 1e-12);
}

}  // namespace
}  // namespace throwcal
