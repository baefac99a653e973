// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/flight_fit.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "estimator/fit_memory.h"
#include "tests/support/thrower.h"

namespace throwcal {
namespace {

using test::make_thrown;
using test::ThrowerSettings;
using test::Thrown;

/// The true flight in a camera's axes at a moment of that camera's clock.
BallState truth_in_camera(const Thrown& scene, std::size_t flight, CameraId camera, HostTime time) {
  const Flight& f = scene.flights[flight];
  const double since_start_s = seconds(time - f.start) + scene.time_offset_s[camera];
  const BallState world = fly({f.position_world_m, f.velocity_world_mps}, since_start_s,
                              {0, 0, -scene.rig.gravity_mps2}, f.drag_per_m);
  const Rigid T_cam_world = scene.T_world_cam[camera].inverse();
  return {T_cam_world * world.position_m, T_cam_world.rotation * world.velocity_mps};
}

const Track& track_of(const Thrown& scene, std::size_t flight, std::size_t index) {
  return scene.throws[flight].tracks[index];
}

/// Squared error of position and velocity over its covariance: chi-square of 6 degrees of freedom.
double normalised_error(const CameraFlight& flight, const BallState& truth) {
  Eigen::Matrix<double, 6, 1> e;
  e << flight.position_cam_m - truth.position_m, flight.velocity_cam_mps - truth.velocity_mps;
  return e.dot(flight.covariance.topLeftCorner<6, 6>().ldlt().solve(e));
}

TEST(FlightFit, APerfectTrackGivesBackItsFlight) {
  const Thrown scene = make_thrown({.seed = 3, .throws = 2, .sigma_px = 1e-6});
  for (const Track& track : scene.throws[1].tracks) {
    const auto flight = fit_flight(scene.rig.cameras[track.camera].model, track.sightings);
    ASSERT_TRUE(flight);
    const BallState truth = truth_in_camera(scene, 1, track.camera, flight->epoch);
    EXPECT_LT((flight->position_cam_m - truth.position_m).norm(), 1e-4);
    EXPECT_LT((flight->velocity_cam_mps - truth.velocity_mps).norm(), 1e-4);
    EXPECT_NEAR(flight->gravity_cam_mps2.norm(), scene.rig.gravity_mps2, 1e-9);
    const Eigen::Vector3d down = scene.T_world_cam[track.camera].rotation.transpose() *
                                 Eigen::Vector3d(0, 0, -scene.rig.gravity_mps2);
    EXPECT_LT((flight->gravity_cam_mps2 - down).norm(), 1e-3);
  }
}

TEST(FlightFit, ItsCovarianceIsHonest) {
  // Mean of chi-square(6) over n flights: 6 +- 3 sqrt(12 / n); the linearised covariance of a
  // single camera is bent a little at 0.2 px, hence the added 5 %.
  double sum = 0.0, chi2 = 0.0;
  int n = 0, dof = 0;
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    const Thrown scene = make_thrown({.seed = seed, .sigma_px = 0.05});
    for (std::size_t j = 0; j < scene.throws.size(); ++j)
      for (const Track& track : scene.throws[j].tracks) {
        if (track.sightings.size() < 40) continue;
        const auto flight = fit_flight(scene.rig.cameras[track.camera].model, track.sightings);
        ASSERT_TRUE(flight);
        sum += normalised_error(*flight, truth_in_camera(scene, j, track.camera, flight->epoch));
        chi2 += flight->chi2;
        dof += flight->dof;
        ++n;
      }
  }
  ASSERT_GT(n, 100);
  EXPECT_NEAR(sum / n, 6.0, 3.0 * std::sqrt(12.0 / n) + 0.3);
  EXPECT_NEAR(chi2 / dof, 1.0, 3.0 * std::sqrt(2.0 / dof) + 0.01);
}

TEST(FlightFit, GravityKnownMakesItSharper) {
  const Thrown scene = make_thrown({.seed = 5});
  Track track = track_of(scene, 0, 0);
  track.sightings.resize(25);  // 0.4 s: short enough for gravity's direction to matter
  const CameraModel& model = scene.rig.cameras[track.camera].model;
  FlightFitSettings levelled;
  levelled.gravity_cam_mps2 = scene.T_world_cam[track.camera].rotation.transpose() *
                              Eigen::Vector3d(0, 0, -scene.rig.gravity_mps2);
  const auto alone = fit_flight(model, track.sightings),
             sharper = fit_flight(model, track.sightings, levelled);
  ASSERT_TRUE(alone && sharper);
  const BallState truth = truth_in_camera(scene, 0, track.camera, sharper->epoch);
  const auto variance = [](const CameraFlight& f) {
    return f.covariance.diagonal().head<3>().sum();
  };
  EXPECT_LT(variance(*sharper), 0.5 * variance(*alone));
  EXPECT_LT(normalised_error(*sharper, truth), 27.9);  // chi-square(6), 1e-4
}

TEST(FlightFit, GrossOutliersAreFoundAndLeftOut) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    const Thrown scene = make_thrown({.seed = seed, .throws = 2, .outlier_fraction = 0.05});
    for (std::size_t j = 0; j < scene.throws.size(); ++j)
      for (const Track& track : scene.throws[j].tracks) {
        if (track.sightings.size() < 30) continue;
        const auto flight = fit_flight(scene.rig.cameras[track.camera].model, track.sightings);
        ASSERT_TRUE(flight) << "seed " << seed;
        const BallState truth = truth_in_camera(scene, j, track.camera, flight->epoch);
        EXPECT_LT(normalised_error(*flight, truth), 40.0) << "seed " << seed;
        EXPECT_GE(4 * std::count(flight->used.begin(), flight->used.end(), true),
                  3 * std::ssize(track.sightings));
      }
  }
}

TEST(FlightFit, WrongNoiseIsMeasuredWhereItIsNotKnown) {
  Thrown scene = make_thrown({.seed = 8, .throws = 1, .sigma_px = 0.2});
  Track track = track_of(scene, 0, 0);
  for (BallSighting& s : track.sightings) s.cov_px2 = Eigen::Matrix2d::Identity();  // says 1 px
  FlightFitSettings settings;
  settings.noise_known = false;
  const auto flight = fit_flight(scene.rig.cameras[track.camera].model, track.sightings, settings);
  ASSERT_TRUE(flight);
  EXPECT_NEAR(flight->noise_scale, 0.2, 0.06);  // a median of 50: 12 % at 1 sigma
}

TEST(FlightFit, DragIsEstimatedWithItsPrior) {
  const Thrown scene = make_thrown({.seed = 4, .throws = 3, .sigma_px = 0.02, .drag_per_m = 0.1});
  FlightFitSettings settings;
  settings.sigma_drag_per_m = 0.2;
  for (const Track& track : scene.throws[0].tracks) {
    const auto flight =
        fit_flight(scene.rig.cameras[track.camera].model, track.sightings, settings);
    ASSERT_TRUE(flight);
    const double sigma = std::sqrt(flight->covariance(9, 9));
    EXPECT_GT(sigma, 0.0);
    EXPECT_NEAR(flight->drag_per_m, 0.1, 4 * sigma);
    EXPECT_LT(flight->chi2 / flight->dof, 1.6);
  }
}

TEST(FlightFit, ARollingShuttersTimesAreTheRowsTimes) {
  const Thrown scene = make_thrown({.seed = 6, .throws = 1, .sigma_px = 1e-5, .row_time_s = 20e-6});
  const Track& track = track_of(scene, 0, 0);
  const auto flight = fit_flight(scene.rig.cameras[track.camera].model, track.sightings);
  ASSERT_TRUE(flight);
  const BallState truth = truth_in_camera(scene, 0, track.camera, flight->epoch);
  EXPECT_LT((flight->position_cam_m - truth.position_m).norm(), 1e-3);
}

TEST(FlightFit, ManyFlightsAgreeOnGravity) {
  const Thrown scene = make_thrown({.seed = 7, .throws = 6});
  std::vector<Track> tracks;
  for (const Throw& thrown : scene.throws)
    for (const Track& track : thrown.tracks)
      if (track.camera == 1) tracks.push_back(track);
  ASSERT_GE(tracks.size(), 4u);
  FitMemory fits;
  const auto flights = fit_flights(scene.rig.cameras[1].model, tracks, {}, fits);
  const Eigen::Vector3d down =
      scene.T_world_cam[1].rotation.transpose() * -Eigen::Vector3d::UnitZ();
  for (const auto& flight : flights) {
    ASSERT_TRUE(flight);
    const double angle = std::acos(flight->gravity_cam_mps2.normalized().dot(down));
    EXPECT_LT(angle, 0.5 * std::numbers::pi / 180);  // the method's figure: 0.2 degrees off at most
  }
}

TEST(FlightFit, WhatIsNoFlightGivesNothing) {
  const Thrown scene = make_thrown({.seed = 9, .throws = 1});
  const Track& track = track_of(scene, 0, 0);
  const CameraModel& model = scene.rig.cameras[track.camera].model;
  EXPECT_FALSE(fit_flight(model, {}));
  EXPECT_FALSE(fit_flight(model, std::span(track.sightings).first(4)));

  Track still = track;
  for (BallSighting& s : still.sightings) s.center_px = {300.0, 200.0};
  EXPECT_FALSE(fit_flight(model, still.sightings));

  Track uniform = track;
  for (std::size_t i = 0; i < uniform.sightings.size(); ++i)
    uniform.sightings[i].center_px = {100.0 + 10.0 * static_cast<double>(i), 200.0};
  EXPECT_FALSE(fit_flight(model, uniform.sightings));

  Track same_time = track;
  for (BallSighting& s : same_time.sightings) s.time = track.sightings[0].time;
  EXPECT_FALSE(fit_flight(model, same_time.sightings));

  Track broken = track;
  for (BallSighting& s : broken.sightings) s.cov_px2.setZero();
  EXPECT_FALSE(fit_flight(model, broken.sightings));
}

TEST(FlightFit, TheStateElsewhereIsTheFlightsOwn) {
  const Thrown scene = make_thrown({.seed = 2, .throws = 1, .sigma_px = 0.05});
  const Track& track = track_of(scene, 0, 1);
  const auto flight = fit_flight(scene.rig.cameras[track.camera].model, track.sightings);
  ASSERT_TRUE(flight);
  const BallState truth =
      truth_in_camera(scene, 0, track.camera, flight->epoch + from_seconds(0.3));
  Eigen::Matrix<double, 6, 1> e;
  e << flight->at(0.3).position_m - truth.position_m,
      flight->at(0.3).velocity_mps - truth.velocity_mps;
  EXPECT_LT(e.dot(flight->covariance_at(0.3).ldlt().solve(e)), 27.9);  // chi-square(6), 1e-4
}

}  // namespace
}  // namespace throwcal
