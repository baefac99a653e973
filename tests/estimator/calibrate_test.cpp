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

}  // namespace
}  // namespace throwcal
