// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/next_throw.h"

#include "estimator/calibrate.h"
#include "tests/support/true_solution.h"

namespace throwcal {
namespace {

using test::make_thrown;
using test::Thrown;

/// The recording with one more throw, as proposed.
Thrown with_throw(const Thrown& thrown, const NextThrow& next, std::uint64_t seed) {
  Thrown out = thrown;
  Throw added{"next", {}};
  std::mt19937_64 engine(seed);
  std::normal_distribution<double> noise(0.0, 0.2);
  for (CameraId k = 0; k < out.rig.cameras.size(); ++k) {
    Track track{k, {}};
    for (int n = 0; n < 48; ++n) {
      const BallState ball = fly({next.position_world_m, next.velocity_world_mps}, n / 60.0,
                                 {0, 0, -thrown.rig.gravity_mps2}, 0.0);
      const auto pixel =
          out.rig.cameras[k].model.project(out.T_world_cam[k].inverse() * ball.position_m);
      if (!pixel || !out.rig.cameras[k].model.contains(*pixel, 1.0)) continue;
      track.sightings.push_back({k, HostTime(from_seconds(100.0 + n / 60.0)),
                                 *pixel + Eigen::Vector2d(noise(engine), noise(engine)),
                                 0.04 * Eigen::Matrix2d::Identity(), std::nullopt,
                                 100000 + 100 * k + static_cast<std::uint64_t>(n)});
    }
    added.tracks.push_back(std::move(track));
  }
  out.throws.push_back(std::move(added));
  return out;
}

double worst_over_target(const Calibration& at, const RigDescription& rig) {
  double worst = 0.0;
  for (const CameraCalibration& camera : at.cameras) {
    const Eigen::Matrix<double, 6, 1> variance = camera.covariance->diagonal();
    worst = std::max({worst, std::sqrt(variance.head<3>().sum()) / rig.target.position_m,
                      std::sqrt(variance.tail<3>().sum()) / rig.target.rotation_rad});
  }
  return worst;
}

TEST(NextThrow, WhatItPromisesIsWhatTheThrowBrings) {
  const Thrown thrown = make_thrown({.throws = 2});
  const Calibration before = calibrate(thrown.rig, thrown.throws);
  ASSERT_TRUE(before.next_throw);
  const NextThrow& next = *before.next_throw;
  EXPECT_GE(next.cameras.size(), 2u);
  EXPECT_LT(next.expected_sigma_position_m, next.sigma_position_m);
  const Thrown more = with_throw(thrown, next, 1);
  const Calibration after = calibrate(more.rig, more.throws);
  const Eigen::Matrix<double, 6, 1> variance = after.cameras[next.camera].covariance->diagonal();
  // The promise is made at six moments of the flight in place of 48, and at the estimate.
  EXPECT_NEAR(std::sqrt(variance.head<3>().sum()) / next.expected_sigma_position_m, 1.0, 0.1);
}

TEST(NextThrow, ItHelpsMoreThanThrowingTheSameAgain) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const Thrown thrown = make_thrown({.seed = seed, .throws = 2});
    const Calibration before = calibrate(thrown.rig, thrown.throws);
    ASSERT_TRUE(before.next_throw);
    const Thrown proposed = with_throw(thrown, *before.next_throw, seed);
    NextThrow again = *before.next_throw;
    again.position_world_m = before.throws[0].position_world_m;
    again.velocity_world_mps = before.throws[0].velocity_world_mps;
    const Thrown repeated = with_throw(thrown, again, seed);
    EXPECT_LT(worst_over_target(calibrate(proposed.rig, proposed.throws), thrown.rig),
              worst_over_target(calibrate(repeated.rig, repeated.throws), thrown.rig))
        << "seed " << seed;
  }
}

TEST(NextThrow, AfterDropsItSaysThrowAcross) {
  const Thrown thrown = make_thrown({.duration_s = 0.6, .vertical_drops = true});
  const auto timed = time_throws(thrown.rig, thrown.throws);
  const auto next = best_next_throw(thrown.rig, timed,
                                    refine(thrown.rig, timed, test::true_solution(thrown, timed)));
  ASSERT_TRUE(next);
  EXPECT_GT(next->velocity_world_mps.head<2>().norm(), 0.5);
  EXPECT_NE(next->text.find("throw from"), std::string::npos);
}

TEST(NextThrow, WithoutAPlacedPairThereIsNone) {
  const Calibration nothing = calibrate(make_thrown({}).rig, {});
  EXPECT_FALSE(nothing.next_throw);
}

}  // namespace
}  // namespace throwcal
