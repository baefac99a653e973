// SPDX-License-Identifier: BSD-3-Clause
#include "capture/ball_detector.h"

#include <gtest/gtest.h>

#include <cmath>

#include "capture/camera_factory.h"

namespace throwcal {
namespace {

/// What a detector made of the frames of simulated cameras, beside the truth.
struct Score {
  int frames = 0, flying = 0, found = 0, whole = 0, elsewhere = 0;
  Eigen::Vector2d sum_px = Eigen::Vector2d::Zero();
  double squares_px2 = 0, normalised = 0, log_radius = 0;

  /// Of balls seen whole; what is partly hidden says so, and its errors count by their sigmas.
  double rms_px() const { return std::sqrt(squares_px2 / (2 * whole)); }
  double bias_px() const { return (sum_px / whole).norm(); }
  double normalised_error() const { return normalised / (2 * found); }
  double recall() const { return static_cast<double>(found) / flying; }
  std::string text() const {
    return std::to_string(found) + " of " + std::to_string(flying) + " found, " +
           std::to_string(whole) + " whole, RMS " + std::to_string(rms_px()) + " px, bias " +
           std::to_string(bias_px()) + " px, normalised error " +
           std::to_string(normalised_error()) + ", " + std::to_string(elsewhere) +
           " sightings elsewhere";
  }
};

struct Seen {
  Eigen::Vector2d pixel;
  double radius_px;
  bool is_flying;
};

/// True projection of the ball's centre; of a rolling shutter, when its row is exposed.
std::optional<Seen> seen(const SimulatedScene& scene, CameraId id, double row0_s) {
  const CameraModel model = scene.rig().cameras[id].model;
  std::optional<Seen> out;
  double time_s = row0_s;
  for (int i = 0; i < 10; ++i) {
    const auto ball = scene.ball_at(time_s);
    if (!ball) return std::nullopt;
    const Eigen::Vector3d at = scene.T_world_cam(id).inverse() * ball->position_world_m;
    const auto pixel = model.project(at);
    if (!pixel) return std::nullopt;
    out = {*pixel, 0.5 * scene.rig().ball.diameter_m * model.fx_px / at.z(), !ball->in_hand};
    time_s = row0_s + model.row_time_s * pixel->y();
  }
  return out;
}

Score watch(const SimulatedSceneSettings& settings, CameraId id, double end_s) {
  const auto scene = std::make_shared<const SimulatedScene>(settings);
  CameraSource source;
  source.id = id;
  source.source = "simulated";
  source.model = scene->rig().cameras[id].model;
  source.scene = scene;
  source.paced = false;
  source.scene_end_s = end_s;
  const auto camera = make_camera(source);
  BallDetector detector(source.model, scene->rig().ball.diameter_m);
  std::vector<std::uint8_t> slot(static_cast<std::size_t>(settings.width_px * settings.height_px));
  Frame frame;
  Score score;
  camera->start();
  for (; camera->next(slot, frame) == Camera::Outcome::frame; ++score.frames) {
    const FrameSightings found = detector.detect(frame);
    EXPECT_EQ(found.time, frame.row0_mid_exposure);
    const double true_s =
        seconds(frame.row0_mid_exposure.time_since_epoch()) + scene->time_offset_s(id);
    const auto truth = seen(*scene, id, true_s);
    const bool counts = truth && truth->is_flying &&
                        source.model.contains(truth->pixel, 1.3 * truth->radius_px + 3);
    score.flying += counts;
    for (const BallSighting& sighting : found.sightings) {
      const Eigen::Vector2d error =
          counts ? Eigen::Vector2d(sighting.center_px - truth->pixel) : Eigen::Vector2d(1e3, 0);
      if (error.norm() > 1.0) {
        ++score.elsewhere;
        continue;
      }
      ++score.found;
      if (!sighting.is_partial) {
        ++score.whole;
        score.sum_px += error;
        score.squares_px2 += error.squaredNorm();
      }
      score.normalised += error.dot(sighting.cov_px2.inverse() * error);
      score.log_radius += std::log(*sighting.radius_px / truth->radius_px);
    }
  }
  return score;
}

class BallDetectorOnCamera : public testing::TestWithParam<CameraId> {};
INSTANTIATE_TEST_SUITE_P(, BallDetectorOnCamera, testing::Values(0, 1, 2, 3));

// Balls of 3 to 5 px radius, pixel noise of 2 to 3 grey levels on a contrast of 30 to 150. The
// noise alone gives 0.02 px; the rest is what stands behind the ball. A bias counts most: it is the
// same in all of a flight, so that a calibration cannot average it away.
TEST_P(BallDetectorOnCamera, FindsTheProjectionOfABallsCentre) {
  const Score score = watch({.seed = 11}, GetParam(), 5.6);
  EXPECT_GT(score.recall(), 0.95) << score.text();
  EXPECT_LT(score.rms_px(), 0.06) << score.text();
  EXPECT_LT(score.bias_px(), 0.015) << score.text();
  EXPECT_GT(score.normalised_error(), 0.4) << score.text();
  EXPECT_LT(score.normalised_error(), 2.0) << score.text();
  EXPECT_LT(std::abs(score.log_radius / score.found), 0.1);
  RecordProperty("score", score.text());
}

// Twice as near, sharper lens: 10 to 20 px radius. What perspective moves the outline by is then
// up to 0.4 px, so the bias shows that it is taken back.
TEST(BallDetector, CorrectsALargeBallForPerspective) {
  const Score score = watch(
      {.seed = 4, .side_m = 4.0, .width_px = 1280, .height_px = 960, .focal_px = 900}, 2, 2.2);
  EXPECT_GT(score.found, 20) << score.text();
  EXPECT_LT(score.rms_px(), 0.06) << score.text();
  EXPECT_LT(score.bias_px(), 0.03) << score.text();
}

// The ball moves by up to 5 px in 8 ms, one and a half times its radius: what is the streak and
// what the shade along it is then harder to tell. Its beginning or end would be 2 px off.
TEST(BallDetector, TakesTheMiddleOfAStreak) {
  const Score score = watch({.seed = 6, .exposure_s = 0.008}, 1, 2.05);
  EXPECT_GT(score.recall(), 0.9) << score.text();
  EXPECT_LT(score.rms_px(), 0.08) << score.text();
  EXPECT_LT(score.bias_px(), 0.03) << score.text();
}

TEST(BallDetector, ARollingShutterSeesTheBallWhenItsRowIsExposed) {
  const Score score = watch({.seed = 8, .row_time_s = 22e-6}, 0, 3.4);
  EXPECT_GT(score.recall(), 0.9) << score.text();
  EXPECT_LT(score.rms_px(), 0.08) << score.text();
}

// 0.7 s of nothing but noise, before the first swing: 21 frames are examined.
TEST(BallDetector, SeesNothingInAnEmptyScene) {
  const Score score = watch({.seed = 3}, 0, 0.68);
  EXPECT_GT(score.frames, 38);
  EXPECT_EQ(score.elsewhere, 0);
}

}  // namespace
}  // namespace throwcal
