// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/flight_alignment.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "estimator/fit_memory.h"
#include "tests/support/jacobian_check.h"
#include "tests/support/thrower.h"

namespace throwcal {
namespace {

using test::make_thrown;
using test::Thrown;

/// The flights that both cameras see, each camera's fitted with its own common gravity.
std::vector<FlightPair> shared_flights(const Thrown& scene, CameraId a, CameraId b,
                                       const FlightFitSettings& settings = {}) {
  std::vector<Track> tracks_a, tracks_b;
  for (const Throw& thrown : scene.throws) {
    const Track *in_a = nullptr, *in_b = nullptr;
    for (const Track& track : thrown.tracks) {
      if (track.camera == a && track.sightings.size() >= 15) in_a = &track;
      if (track.camera == b && track.sightings.size() >= 15) in_b = &track;
    }
    if (!in_a || !in_b) continue;
    tracks_a.push_back(*in_a);
    tracks_b.push_back(*in_b);
  }
  FitMemory fits;
  const auto flights_a = fit_flights(scene.rig.cameras[a].model, tracks_a, settings, fits);
  const auto flights_b = fit_flights(scene.rig.cameras[b].model, tracks_b, settings, fits);
  std::vector<FlightPair> out;
  for (std::size_t i = 0; i < flights_a.size(); ++i)
    if (flights_a[i] && flights_b[i]) out.emplace_back(*flights_a[i], *flights_b[i]);
  return out;
}

struct Error {
  double position_m, rotation_rad, offset_s;
};

Error error_of(const Thrown& scene, CameraId a, CameraId b, const CameraAlignment& found) {
  const Rigid truth = scene.T_world_cam[a].inverse() * scene.T_world_cam[b];
  return {(found.T_a_b.translation - truth.translation).norm(),
          log_so3(found.T_a_b.rotation * truth.rotation.transpose()).norm(),
          std::abs(found.offset_b_minus_a_s - (scene.time_offset_s[b] - scene.time_offset_s[a]))};
}

TEST(FlightAlignment, ThrowsGiveTheRelativePoseAndTheClock) {
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    const Thrown scene = make_thrown({.seed = seed, .max_offset_s = 0.015});
    for (CameraId b : {1u, 2u, 3u}) {
      const auto pairs = shared_flights(scene, 0, b);
      ASSERT_GE(pairs.size(), 2u);
      const auto found = align_cameras(pairs);
      ASSERT_TRUE(found) << "seed " << seed << " camera " << b;
      const Error error = error_of(scene, 0, b, *found);
      // The method's figures for such a start: 1-6 mrad, 6-34 mm; doubled as a bound.
      EXPECT_LT(error.position_m, 0.07) << "seed " << seed << " camera " << b;
      EXPECT_LT(error.rotation_rad, 0.012) << "seed " << seed << " camera " << b;
      EXPECT_LT(error.offset_s, 1e-3) << "seed " << seed << " camera " << b;
    }
  }
}

TEST(FlightAlignment, OneThrowIsEnough) {
  const Thrown scene = make_thrown({.seed = 2, .throws = 1, .max_offset_s = 0.015});
  const auto pairs = shared_flights(scene, 0, 1);
  ASSERT_EQ(pairs.size(), 1u);
  const auto found = align_cameras(pairs);
  ASSERT_TRUE(found);
  const Error error = error_of(scene, 0, 1, *found);
  EXPECT_LT(error.position_m, 0.15);
  EXPECT_LT(error.rotation_rad, 0.03);
  EXPECT_LT(error.offset_s, 2e-3);
}

TEST(FlightAlignment, SynchronisedCamerasKeepTheirOffsetAtNought) {
  const Thrown scene = make_thrown({.seed = 3});
  const auto found = align_cameras(shared_flights(scene, 0, 2), {.estimate_offset = false});
  ASSERT_TRUE(found);
  EXPECT_EQ(found->offset_b_minus_a_s, 0.0);
  EXPECT_EQ(found->covariance(4, 4), 0.0);
  EXPECT_LT(error_of(scene, 0, 2, *found).position_m, 0.07);
}

TEST(FlightAlignment, AWrongPairIsFoundAndLeftOut) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const Thrown scene = make_thrown({.seed = seed, .throws = 6});
    auto pairs = shared_flights(scene, 0, 1);
    ASSERT_GE(pairs.size(), 3u);
    // Camera b's flight of the second throw, told to be the first's.
    const HostTime epoch = pairs[0].second.epoch;
    pairs[0].second = pairs[1].second;
    pairs[0].second.epoch = epoch;
    const auto found = align_cameras(pairs);
    ASSERT_TRUE(found) << "seed " << seed;
    EXPECT_FALSE(found->used[0]) << "seed " << seed;
    for (std::size_t i = 1; i < pairs.size(); ++i) EXPECT_TRUE(found->used[i]);
    EXPECT_LT(error_of(scene, 0, 1, *found).position_m, 0.07) << "seed " << seed;
  }
}

TEST(FlightAlignment, OfManyPairsEachIsJudgedThoughSomeTellIt) {
  const Thrown scene = make_thrown({.seed = 6, .throws = 60});
  auto pairs = shared_flights(scene, 0, 1);
  ASSERT_GE(pairs.size(), 40u);
  for (std::size_t i = 0; i + 1 < pairs.size(); i += 5) {
    const HostTime epoch = pairs[i].second.epoch;
    pairs[i].second = pairs[i + 1].second;
    pairs[i].second.epoch = epoch;
  }
  const auto found = align_cameras(pairs);
  ASSERT_TRUE(found);
  ASSERT_EQ(found->used.size(), pairs.size());
  for (std::size_t i = 0; i < pairs.size(); ++i)
    EXPECT_EQ(found->used[i], i % 5 != 0 || i + 1 == pairs.size()) << "pair " << i;
  EXPECT_LT(error_of(scene, 0, 1, *found).position_m, 0.02);
}

TEST(FlightAlignment, ADropFromOneSpotHasNoHeading) {
  const Thrown scene =
      make_thrown({.seed = 4, .throws = 1, .duration_s = 0.6, .vertical_drops = true});
  const auto pairs = shared_flights(scene, 0, 1);
  ASSERT_EQ(pairs.size(), 1u);
  EXPECT_FALSE(align_cameras(pairs));
}

TEST(FlightAlignment, NoFlightsNoAlignment) { EXPECT_FALSE(align_cameras({})); }

TEST(FlightAlignment, TheApexIsWhereTheBallStopsClimbing) {
  for (double drag : {0.0, 0.05}) {
    const Thrown scene = make_thrown({.seed = 5, .throws = 1, .drag_per_m = drag});
    FlightFitSettings settings;
    settings.drag_per_m = drag;
    const Track& track = scene.throws[0].tracks[0];
    const auto flight =
        fit_flight(scene.rig.cameras[track.camera].model, track.sightings, settings);
    ASSERT_TRUE(flight);
    const BallState top = flight->at(apex_s(*flight));
    EXPECT_LT(std::abs(top.velocity_mps.dot(flight->gravity_cam_mps2.normalized())), 1e-3);
  }
}

TEST(FlightAlignment, LevelAxesPointUpwards) {
  for (const Eigen::Vector3d& gravity : {Eigen::Vector3d(0.3, 9.7, 1.0), Eigen::Vector3d(9.8, 0, 0),
                                         Eigen::Vector3d(0, 0, 9.8), Eigen::Vector3d(0, 0, -9.8)}) {
    const Eigen::Matrix3d L = level_rotation(gravity);
    EXPECT_LT((L * L.transpose() - Eigen::Matrix3d::Identity()).norm(), 1e-12);
    EXPECT_NEAR(L.determinant(), 1.0, 1e-12);
    EXPECT_LT((L * gravity.normalized() + Eigen::Vector3d::UnitZ()).norm(), 1e-12);
  }
}

TEST(FlightAlignment, ItsJacobianIsTheDerivativeWhereTheFlightsAgree) {
  const Thrown scene = make_thrown({.sigma_px = 1e-7, .max_offset_s = 0.01});
  const auto pairs = shared_flights(scene, 0, 1);
  const auto aligned = align_cameras(pairs);
  ASSERT_TRUE(aligned);
  const auto& [a, b] = pairs[0];
  const FlightDifference at = difference(*aligned, a, b);
  EXPECT_LT(at.value.norm(), 1e-3);
  test::expect_jacobian(
      [&](const Eigen::VectorXd& d) {
        CameraAlignment moved = *aligned;
        moved.T_a_b.rotation =
            exp_so3(-d[0] * a.gravity_cam_mps2.normalized()) * moved.T_a_b.rotation;
        moved.T_a_b.translation += d.segment<3>(1);
        moved.offset_b_minus_a_s += d[4];
        return Eigen::VectorXd(difference(moved, a, b).value);
      },
      at.J, 1e-5, 1e-4);
}

}  // namespace
}  // namespace throwcal
