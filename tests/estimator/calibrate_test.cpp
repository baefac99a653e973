// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/calibrate.h"

#include <gtest/gtest.h>

#include <cmath>

#include "estimator/refinement.h"
#include "tests/support/true_solution.h"

namespace throwcal {
namespace {

using test::make_thrown;
using test::Thrown;

double worst_position_m(const Thrown& truth, const Calibration& at) {
  double worst = 0;
  for (std::size_t k = 1; k < at.cameras.size(); ++k)
    worst = std::max(
        worst, (at.cameras[k].T_world_cam->translation - truth.T_world_cam[k].translation).norm());
  return worst;
}

TEST(Calibrate, FiveThrowsPlaceFourFreeRunningCamerasWithoutAGuess) {
  const Thrown thrown = make_thrown(
      {.state_sigma = false, .max_offset_s = 0.015, .drag_per_m = 0.0175, .estimate_drag = true});
  const Calibration at = calibrate(thrown.rig, thrown.throws);
  ASSERT_EQ(at.verdict, Verdict::accepted) << (at.reasons.empty() ? "" : at.reasons[0]);
  EXPECT_LT(worst_position_m(thrown, at), 0.008);  // the bound's sigma is about 2 mm
  EXPECT_NEAR(at.drag_per_m, 0.0175, 4 * *at.sigma_drag_per_m);
  for (std::size_t k = 1; k < 4; ++k)
    EXPECT_NEAR(at.cameras[k].time_offset_s, thrown.time_offset_s[k],
                4 * *at.cameras[k].sigma_time_offset_s);
  ASSERT_EQ(at.throws.size(), 5u);
  EXPECT_EQ(at.throws[2].id, "3");
}

TEST(Calibrate, ItIsAsGoodAsARefinementStartedAtTheTruth) {
  // The same optimum: differences are far below the noise's own sigma.
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const Thrown thrown = make_thrown({.seed = seed});
    const auto timed = time_throws(thrown.rig, thrown.throws);
    const Refinement ideal = refine(thrown.rig, timed, test::true_solution(thrown, timed));
    const Calibration at = calibrate(thrown.rig, thrown.throws);
    for (std::size_t k = 1; k < 4; ++k)
      EXPECT_LT(
          (at.cameras[k].T_world_cam->translation - ideal.solution.rig.T_world_cam[k].translation)
              .norm(),
          1e-5);
  }
}

TEST(Calibrate, AThrowIsReportedWhereTheBallWasWhenItWasFirstSeen) {
  const Thrown thrown = make_thrown({});
  const Calibration at = calibrate(thrown.rig, thrown.throws);
  for (std::size_t j = 0; j < at.throws.size(); ++j) {
    const Flight& truth = thrown.flights[j];
    const BallState ball = fly({truth.position_world_m, truth.velocity_world_mps},
                               seconds(at.throws[j].start - truth.start), {0, 0, -9.80665}, 0.0);
    EXPECT_LT((at.throws[j].position_world_m - ball.position_m).norm(), 0.01);
    EXPECT_LT((at.throws[j].velocity_world_mps - ball.velocity_mps).norm(), 0.03);
    EXPECT_LT(seconds(at.throws[j].end - at.throws[j].start), 0.91);
  }
}

// A box calibrates after each throw; whoever repeats it, once.
TEST(Calibrate, WhatWasFittedForEarlierThrowsChangesNothing) {
  const Thrown thrown = make_thrown({.seed = 4, .throws = 20, .state_sigma = false});
  FitMemory fits;
  CalibrateSettings remembering;
  remembering.fits = &fits;
  std::vector<Throw> so_far;
  for (const Throw& next : thrown.throws) {
    so_far.push_back(next);
    const Calibration at = calibrate(thrown.rig, so_far, remembering);
    const Calibration once = calibrate(thrown.rig, so_far);
    ASSERT_EQ(at.throws.size(), once.throws.size());
    for (std::size_t k = 0; k < at.cameras.size(); ++k) {
      ASSERT_EQ(at.cameras[k].T_world_cam.has_value(), once.cameras[k].T_world_cam.has_value());
      if (!at.cameras[k].T_world_cam) continue;
      EXPECT_EQ(at.cameras[k].T_world_cam->translation, once.cameras[k].T_world_cam->translation);
      EXPECT_EQ(at.cameras[k].T_world_cam->rotation, once.cameras[k].T_world_cam->rotation);
      EXPECT_EQ(at.cameras[k].covariance, once.cameras[k].covariance);
      EXPECT_EQ(at.cameras[k].time_offset_s, once.cameras[k].time_offset_s);
    }
  }
  EXPECT_EQ(calibrate(thrown.rig, so_far, remembering).throws.size(), thrown.throws.size());
}

TEST(Calibrate, NoThrowsIsNoCalibrationButAnExplanation) {
  const Calibration at = calibrate(make_thrown({}).rig, {});
  EXPECT_EQ(at.verdict, Verdict::unobservable);
  ASSERT_EQ(at.reasons.size(), 1u);
  EXPECT_NE(at.reasons[0].find("no throw"), std::string::npos);
  EXPECT_FALSE(at.cameras[1].T_world_cam);
}

TEST(Calibrate, VerticalDropsFromOneSpotDoNotShowTheHeading) {
  const Calibration at = calibrate(make_thrown({.duration_s = 0.6, .vertical_drops = true}).rig,
                                   make_thrown({.duration_s = 0.6, .vertical_drops = true}).throws);
  EXPECT_EQ(at.verdict, Verdict::unobservable);
  EXPECT_NE(at.reasons.at(0).find("throw across"), std::string::npos) << at.reasons[0];
}

TEST(Calibrate, AnImpatientTargetAsksForMoreThrows) {
  Thrown thrown = make_thrown({.throws = 2});
  thrown.rig.target = {1e-4, 1e-5};
  const Calibration at = calibrate(thrown.rig, thrown.throws);
  EXPECT_EQ(at.verdict, Verdict::needs_more_throws);
  EXPECT_NE(at.reasons.at(0).find("throw more"), std::string::npos);
}

TEST(Calibrate, AWrongLensIsRejected) {
  Thrown thrown = make_thrown({.throws = 8});
  thrown.rig.cameras[2].model.fx_px *= 1.1;
  EXPECT_EQ(calibrate(thrown.rig, thrown.throws).verdict, Verdict::rejected);
}

TEST(Calibrate, ACameraThatSharesNoFlightIsNamedAndTheOthersArePlaced) {
  Thrown thrown = make_thrown({});
  for (Throw& t : thrown.throws)
    std::erase_if(t.tracks, [](const Track& track) { return track.camera == 3; });
  const Calibration at = calibrate(thrown.rig, thrown.throws);
  EXPECT_EQ(at.verdict, Verdict::unobservable);
  EXPECT_NE(at.reasons.at(0).find("cam4"), std::string::npos);
  EXPECT_FALSE(at.cameras[3].T_world_cam);
  ASSERT_TRUE(at.cameras[2].T_world_cam);
  EXPECT_LT((at.cameras[2].T_world_cam->translation - thrown.T_world_cam[2].translation).norm(),
            0.01);
}

TEST(Calibrate, ABadGuessDoesNotHurtTheFullMethod) {
  const Thrown thrown = make_thrown({});
  CalibrateSettings settings;
  settings.guess = Guess{thrown.T_world_cam, {0, 0, 0, 0}, 0.0};
  std::swap(settings.guess->T_world_cam[1], settings.guess->T_world_cam[3]);
  const Calibration guessed = calibrate(thrown.rig, thrown.throws, settings),
                    plain = calibrate(thrown.rig, thrown.throws);
  EXPECT_EQ(guessed.verdict, Verdict::accepted);
  EXPECT_NEAR(worst_position_m(thrown, guessed), worst_position_m(thrown, plain), 1e-5);
}

TEST(Calibrate, RbEkfAloneIsUsableAndHonestAboutIt) {
  const Thrown thrown = make_thrown({});
  CalibrateSettings settings;
  settings.method = Method::rb_ekf;
  const Calibration at = calibrate(thrown.rig, thrown.throws, settings);
  EXPECT_EQ(at.method, Method::rb_ekf);
  EXPECT_LT(worst_position_m(thrown, at), 0.01);
}

TEST(Calibrate, EverySightingGivenHasItsResidual) {
  const Thrown thrown = make_thrown({.outlier_fraction = 0.03});
  const Calibration at = calibrate(thrown.rig, thrown.throws);
  std::size_t given = 0, used = 0, counted = 0;
  for (const Throw& t : thrown.throws)
    for (const Track& track : t.tracks) given += track.sightings.size();
  for (const SightingResidual& r : at.residuals) used += r.used;
  for (const CameraCalibration& c : at.cameras)
    counted += static_cast<std::size_t>(c.sightings_used);
  EXPECT_EQ(at.residuals.size(), given);
  EXPECT_EQ(used, counted);
  EXPECT_LT(used, given);
}

TEST(Calibrate, RoughLensNumbersAreEstimatedWithTheRest) {
  // The thesis' future work: internal and external calibration together. Normalised errors of all
  // estimated lens numbers over some seeds: chi-square, 4 sigma.
  double squares = 0.0, count = 0.0;
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    Thrown thrown = make_thrown({.seed = seed, .throws = 12, .row_time_s = 15e-6});
    for (CameraDescription& camera : thrown.rig.cameras) {
      camera.estimate = {Intrinsic::fx, Intrinsic::fy, Intrinsic::d0, Intrinsic::row_time};
      camera.model.fx_px *= 1.015, camera.model.fy_px *= 0.99;
      camera.model.distortion[0] += 0.02;
      camera.model.row_time_s += 3e-6;
    }
    const Calibration at = calibrate(thrown.rig, thrown.throws);
    EXPECT_NE(at.verdict, Verdict::rejected) << at.reasons.at(0);
    for (std::size_t k = 0; k < 4; ++k) {
      ASSERT_EQ(at.cameras[k].lens.size(), 4u);
      EXPECT_EQ(at.cameras[k].lens[2].name, "k1");
      for (std::size_t i = 0; i < 4; ++i) {
        const LensEstimate& lens = at.cameras[k].lens[i];
        const double truth = thrown.true_models[k].at(thrown.rig.cameras[k].estimate[i]);
        squares += std::pow((lens.value - truth) / lens.sigma, 2), count += 1;
      }
    }
  }
  EXPECT_NEAR(squares / count, 1.0, 4 * std::sqrt(2 / count));
}

/// The same recording with the cameras in another order: another world, camera b's.
Thrown seen_from(const Thrown& thrown, std::size_t first) {
  Thrown out = thrown;
  std::swap(out.rig.cameras[0], out.rig.cameras[first]);
  for (Throw& t : out.throws)
    for (Track& track : t.tracks) {
      const CameraId k = track.camera;
      track.camera = k == 0 ? static_cast<CameraId>(first) : k == first ? 0 : k;
      for (BallSighting& s : track.sightings) s.camera = track.camera;
    }
  return out;
}

TEST(Calibrate, SeenFromAnotherCamerasWorldItIsTheSameRig) {
  for (const bool free_running : {false, true}) {
    const Thrown thrown = make_thrown({.max_offset_s = free_running ? 0.01 : 0.0});
    const Calibration a = calibrate(thrown.rig, thrown.throws);
    const Calibration b = calibrate(seen_from(thrown, 2).rig, seen_from(thrown, 2).throws);
    const auto pose = [](const Calibration& at, std::size_t k) {
      return *at.cameras[k].T_world_cam;
    };
    // Relative poses have no world: camera 3 to camera 1, and its inverse.
    const Rigid of_a = pose(a, 0).inverse() * pose(a, 2), of_b = pose(b, 2).inverse() * pose(b, 0);
    EXPECT_LT((of_a.translation - of_b.translation).norm(), 1e-5);
    EXPECT_LT((of_a.rotation - of_b.rotation).norm(), 1e-6);
    const Rigid back = pose(b, 0).inverse() * pose(b, 2);
    EXPECT_LT((of_a * back).translation.norm(), 1e-5);
    EXPECT_LT(((of_a * back).rotation - Eigen::Matrix3d::Identity()).norm(), 1e-6);
  }
}

TEST(Calibrate, AShiftedRecordingIsTheSameRig) {
  const Thrown thrown = make_thrown({});
  Thrown later = thrown;
  for (Throw& t : later.throws)
    for (Track& track : t.tracks)
      for (BallSighting& s : track.sightings) s.time += std::chrono::hours(24 * 365);
  const Calibration a = calibrate(thrown.rig, thrown.throws),
                    b = calibrate(later.rig, later.throws);
  for (std::size_t k = 0; k < 4; ++k) {
    EXPECT_EQ(a.cameras[k].T_world_cam->translation, b.cameras[k].T_world_cam->translation);
    EXPECT_EQ(*a.cameras[k].covariance, *b.cameras[k].covariance);
  }
}

}  // namespace
}  // namespace throwcal
