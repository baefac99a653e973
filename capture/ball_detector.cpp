// SPDX-License-Identifier: BSD-3-Clause
#include "capture/ball_detector.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>

#include "capture/background.h"
#include "capture/ball_fit.h"
#include "capture/ball_signal.h"
#include "capture/ball_starts.h"
#include "capture/expected_balls.h"
#include "capture/sphere_outline.h"

namespace throwcal {
namespace {

constexpr double min_explained = 0.7, min_streak_explained = 0.75;
constexpr long max_work = 300'000;  ///< of a frame's fits: bounds the time of a busy picture
/// What the model leaves out: felt, the lens' own blur, the rounding of motion to a straight line.
constexpr double sigma_model_px = 0.009, sigma_streak = 0.0038;

constexpr double max_hidden = 0.2, max_foreign = 0.05;  ///< of a ball that is seen whole
/// What a ball that is not adds to the error, in radii: measured; less where it was seen whole
/// before, so that its size and streak are known.
constexpr double sigma_cut = 0.15, sigma_doubtful = 0.075, sigma_expected = 0.02;
constexpr double like_size = 1.35;    ///< a ball's size from frame to frame
constexpr double min_shrink = 0.85;   ///< what looks smaller is partly hidden
constexpr int max_shrunk_frames = 4;  ///< and for longer, is as small
constexpr double same_radii = 0.5;    ///< nearer than that two fits found the same ball

/// What a fit made of a start.
struct SeenBall {
  FittedBall ball;
  KnownBall known;  ///< for the next frame
  bool is_partial = false;
};

/// A long streak fits much that is no ball.
double least_explained(const BallOutline& ball) {
  const double radii = ball.streak_px.norm() / ball.radius_px;
  return min_explained + std::min(1.0, 0.25 * radii) * (min_streak_explained - min_explained);
}

bool is_like(const BallOutline& ball, const BallOutline& expected) {
  return ball.radius_px < like_size * expected.radius_px &&
         expected.radius_px < like_size * ball.radius_px;
}

}  // namespace

struct BallDetector::State {
  CameraModel model;
  double ball_diameter_m;
  BallDetectorSettings settings;
  Background background;
  BallStarts ball_starts;
  ExpectedBalls expected_balls;
  BallFit ball_fit;
  BallSignal signal;
  std::vector<PixelRun> changed;
  std::vector<KnownBall> balls;  ///< of the sightings
  FrameSightings found;
  View view = View::learning;
  std::uint64_t count = 0;

  State(const CameraModel& lens, double diameter_m, const BallDetectorSettings& with)
      : model(lens),
        ball_diameter_m(diameter_m),
        settings(with),
        background(lens.width_px, lens.height_px, with.threshold_sigmas),
        ball_starts(lens.width_px, lens.height_px, with.min_radius_px, with.max_radius_px),
        expected_balls(diameter_m, static_cast<std::size_t>(with.max_sightings)),
        signal(with.ball_colour) {
    // Memory for a busy picture is taken now: later a frame takes none.
    changed.reserve(static_cast<std::size_t>(lens.width_px * lens.height_px) / 16 + 64);
    balls.reserve(static_cast<std::size_t>(settings.max_sightings));
    found.sightings.reserve(static_cast<std::size_t>(settings.max_sightings));
  }

  View look(const Frame& frame);
  void try_start(const cv::Mat& grey, const BallStart& start);
  std::optional<SeenBall> fitted(const cv::Mat& grey, const BallStart& start);
  std::optional<BallSighting> sighting_of(const SeenBall& seen);
  bool is_cut(const BallOutline& outline) const;
  bool is_doubtful(const FittedBall& ball) const;
  bool is_found(const BallOutline& outline) const;
};

bool BallDetector::State::is_cut(const BallOutline& outline) const {
  return !model.contains(outline.centre_px, outline.radius_px);
}

/// Whether something hides a part of the ball, or moves beside it.
bool BallDetector::State::is_doubtful(const FittedBall& ball) const {
  return ball.hidden > max_hidden || ball.foreign > max_foreign || is_cut(ball.outline);
}

bool BallDetector::State::is_found(const BallOutline& outline) const {
  return std::ranges::any_of(balls, [&](const KnownBall& known) {
    return (known.outline.centre_px - outline.centre_px).norm() <
           same_radii * known.outline.radius_px;
  });
}

View BallDetector::State::look(const Frame& frame) {
  const ImageView& image = frame.image;
  if (image.width_px != model.width_px || image.height_px != model.height_px)
    return View::wrong_size;
  const cv::Mat grey = signal.of(image);
  const auto outcome = background.compare_and_learn(grey, changed);
  if (background.is_dark()) return View::dark;
  if (background.is_saturated()) return View::saturated;
  if (outcome == Background::Outcome::learning) return View::learning;
  balls.clear();
  const std::vector<KnownBall>& expected = expected_balls.at(found.time);
  const long enough = ball_fit.work() + max_work;
  for (const BallStart& start : ball_starts.find(grey, background, changed, expected))
    if (start.expected || ball_fit.work() < enough) try_start(grey, start);
  // One that was seen flying and is not, now: it may stand before something as bright as itself.
  for (const KnownBall& ball : expected) try_start(grey, {ball.outline, 0.0, &ball});
  expected_balls.add(found.time, balls);
  return background.is_shaken() ? View::shaken : View::clear;
}

void BallDetector::State::try_start(const cv::Mat& grey, const BallStart& start) {
  if (found.sightings.size() >= static_cast<std::size_t>(settings.max_sightings)) return;
  if (is_found(start.outline)) return;
  const auto seen = fitted(grey, start);
  if (!seen || seen->ball.explained < least_explained(seen->ball.outline)) return;
  if (is_found(seen->ball.outline)) return;
  if (start.expected && !is_like(seen->ball.outline, start.expected->outline)) return;
  if (const auto sighting = sighting_of(*seen)) {
    found.sightings.push_back(*sighting);
    balls.push_back(seen->known);
  }
}

/// What hides a part of a ball makes it look smaller and elsewhere, and fits no worse: where a ball
/// is expected, it is then fitted as that. Where it stays smaller, the frames before were wrong.
std::optional<SeenBall> BallDetector::State::fitted(const cv::Mat& grey, const BallStart& start) {
  const auto form =
      sphere_outline(model, ball_diameter_m, start.outline.centre_px, start.outline.radius_px);
  if (!form) return std::nullopt;
  const auto free = ball_fit.fit(grey, background, form->shape, start.outline);
  const KnownBall* expected = start.expected;
  if (!free && !expected) return std::nullopt;
  SeenBall out;
  if (free) out = {*free, {.outline = free->outline}, is_doubtful(*free)};
  if (expected) {
    const bool is_small = free && !out.is_partial &&
                          free->outline.radius_px < min_shrink * expected->outline.radius_px;
    if (is_small) out.known.shrunk_frames = expected->shrunk_frames + 1;
    out.is_partial |= is_small && out.known.shrunk_frames <= max_shrunk_frames;
    if (!free || out.is_partial) {
      const auto bound =
          ball_fit.fit(grey, background, form->shape, expected->outline, &expected->outline);
      if (!free && !bound) return std::nullopt;
      if (bound) out.ball = *bound, out.known.outline = bound->outline;
    }
  }
  if (!out.is_partial) return out;
  out.known.was_whole = expected && expected->was_whole;
  if (expected) {  // the next frame had better believe those before
    out.known.outline.radius_px = expected->outline.radius_px;
    out.known.outline.streak_px = expected->outline.streak_px;
  }
  return out;
}

std::optional<BallSighting> BallDetector::State::sighting_of(const SeenBall& seen) {
  const BallOutline& ball = seen.ball.outline;
  const auto outline = sphere_outline(model, ball_diameter_m, ball.centre_px, ball.radius_px);
  if (!outline) return std::nullopt;
  double sigma_px = std::hypot(sigma_model_px, sigma_streak * ball.streak_px.norm());
  const double sigma_radii = seen.known.was_whole ? sigma_expected : sigma_doubtful;
  if (seen.is_partial) sigma_px = std::max(sigma_px, sigma_radii * ball.radius_px);
  if (is_cut(ball)) sigma_px = std::max(sigma_px, sigma_cut * ball.radius_px);
  BallSighting out;
  out.camera = found.camera;
  out.time = found.time;
  out.radius_px = ball.radius_px;
  out.center_px = ball.centre_px - outline->offset_px;
  out.is_partial = seen.is_partial;
  out.cov_px2 = seen.ball.cov_centre_px2 + sigma_px * sigma_px * Eigen::Matrix2d::Identity();
  out.cov_px2(0, 1) = out.cov_px2(1, 0);  // to the last bit: what is stored of it is a triangle
  out.id = (static_cast<std::uint64_t>(found.camera) << 40) + count++;
  return out;
}

BallDetector::BallDetector(CameraModel model, double ball_diameter_m, BallDetectorSettings settings)
    : state_(std::make_unique<State>(model, ball_diameter_m, settings)) {}
BallDetector::~BallDetector() = default;
BallDetector::BallDetector(BallDetector&&) noexcept = default;

const FrameSightings& BallDetector::detect(const Frame& frame) {
  State& s = *state_;
  s.found.camera = frame.camera;
  s.found.time = frame.row0_mid_exposure;
  s.found.sightings.clear();
  s.view = s.look(frame);
  return s.found;
}

View BallDetector::view() const { return state_->view; }

std::string_view description(View view) {
  switch (view) {
    case View::clear:
      return "clear";
    case View::learning:
      return "used to learn the background";
    case View::dark:
      return "too dark to see anything in";
    case View::saturated:
      return "saturated: lower the exposure or the gain";
    case View::shaken:
      return "shaken: the whole picture moves";
    case View::wrong_size:
      return "not of the size that the rig file says";
  }
  return "";
}

}  // namespace throwcal
