// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/fit_memory.h"

#include <gtest/gtest.h>

#include "tests/support/thrower.h"

namespace throwcal {
namespace {

using test::make_thrown;
using test::Thrown;

struct Seen {
  Thrown scene = make_thrown({.seed = 2, .throws = 1});
  Track track = scene.throws[0].tracks[0];
  const CameraModel& model = scene.rig.cameras[track.camera].model;
};

TEST(FitMemory, WhatItKnowsIsWhatAFitGives) {
  const Seen seen;
  FitMemory fits;
  const auto fitted = fit_flight(seen.model, seen.track.sightings);
  ASSERT_TRUE(fitted);
  for (int time = 0; time < 2; ++time) {
    const auto& known = fits.of(seen.model, seen.track, {});
    ASSERT_TRUE(known);
    EXPECT_EQ(known->position_cam_m, fitted->position_cam_m);
    EXPECT_EQ(known->covariance, fitted->covariance);
    EXPECT_EQ(known->used, fitted->used);
    fits.forget_unused();
  }
}

TEST(FitMemory, OneSightingMovedInTheMiddleIsAnotherFlight) {
  const Seen seen;
  FitMemory fits;
  const Eigen::Vector3d before = fits.of(seen.model, seen.track, {})->position_cam_m;
  Track moved = seen.track;
  moved.sightings[moved.sightings.size() / 2].center_px.x() += 0.5;
  EXPECT_NE(fits.of(seen.model, moved, {})->position_cam_m, before);
  Track doubted = seen.track;
  doubted.sightings[doubted.sightings.size() / 2].cov_px2 *= 100;
  EXPECT_NE(fits.of(seen.model, doubted, {})->position_cam_m, before);
}

TEST(FitMemory, AnotherGravityIsAnotherFit) {
  const Seen seen;
  FitMemory fits;
  const Eigen::Vector3d before = fits.of(seen.model, seen.track, {})->position_cam_m;
  FlightFitSettings lighter;
  lighter.gravity_mps2 = 9.7;
  EXPECT_NE(fits.of(seen.model, seen.track, lighter)->position_cam_m, before);
  EXPECT_EQ(fits.of(seen.model, seen.track, {})->position_cam_m, before);
}

TEST(FitMemory, OneFlightMoreLeavesTheGravityOfTheEarlierOnes) {
  const Thrown scene = make_thrown({.seed = 7, .throws = 20});
  std::vector<CameraFlight> alone;
  for (const Throw& thrown : scene.throws)
    if (const auto flight = fit_flight(scene.rig.cameras[thrown.tracks[0].camera].model,
                                       thrown.tracks[0].sightings);
        flight && thrown.tracks[0].camera == scene.throws[0].tracks[0].camera)
      alone.push_back(*flight);
  ASSERT_GE(alone.size(), 12u);
  const auto gravity = gravity_of_each(alone), fewer = gravity_of_each(std::span(alone).first(10));
  for (std::size_t i = 0; i < fewer.size(); ++i) EXPECT_EQ(gravity[i], fewer[i]) << "flight " << i;
}

TEST(FitMemory, NothingSeenIsNoFlight) {
  const Seen seen;
  FitMemory fits;
  EXPECT_FALSE(fits.of(seen.model, Track{seen.track.camera, {}}, {}));
  EXPECT_FALSE(fits.of(seen.track.camera, HostTime{}, std::span<const TimedRay>{}, {}));
  EXPECT_TRUE(gravity_of_each({}).empty());
}

}  // namespace
}  // namespace throwcal
