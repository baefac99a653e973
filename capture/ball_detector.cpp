// SPDX-License-Identifier: BSD-3-Clause
#include "capture/ball_detector.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <opencv2/core.hpp>
#include <tuple>

#include "capture/background.h"
#include "capture/ball_fit.h"
#include "capture/ball_signal.h"
#include "capture/blobs.h"
#include "capture/expected_balls.h"
#include "capture/inscribed_discs.h"
#include "capture/sphere_outline.h"

namespace throwcal {
namespace {

constexpr double max_elongation = 4.0;  ///< a streak of a fast ball, not an arm or an edge
constexpr double min_filled = 0.6;      ///< of the ellipse of its moments
constexpr double min_explained = 0.7, min_streak_explained = 0.75;
constexpr int max_parted_px2 = 40000;  ///< of a blob's box: an arm, not a person
constexpr std::size_t max_parts = 3;   ///< of one blob
/// Bounds the time that a busy picture takes: fits, and their work.
constexpr std::size_t max_fits = 32;
constexpr long max_work = 300'000;
/// What the model leaves out: felt, the lens' own blur, the rounding of motion to a straight line.
constexpr double sigma_model_px = 0.009, sigma_streak = 0.0038;

constexpr double min_seen = 0.3;                        ///< of a ball that the picture's edge cuts
constexpr double max_hidden = 0.2, max_foreign = 0.05;  ///< of a ball that is seen whole
/// What a ball that is not adds to the error, in radii: measured; less where it was seen whole
/// before, so that its size and streak are known.
constexpr double sigma_cut = 0.15, sigma_doubtful = 0.075, sigma_expected = 0.02;
constexpr double expected_px = 2.0;  ///< and a radius: how near is as expected
constexpr double speck_area_px2 = 28.0;
constexpr double like_size = 1.35;    ///< a ball's size from frame to frame
constexpr double min_shrink = 0.85;   ///< what looks smaller is partly hidden
constexpr int max_shrunk_frames = 4;  ///< and for longer, is as small
constexpr double same_radii = 0.5;    ///< nearer than that two fits found the same ball

/// Where a fit begins, and why.
struct Start {
  BallOutline outline;
  double promise = 0.0;                 ///< the larger, the sooner it is tried
  const KnownBall* expected = nullptr;  ///< the ball that should be there
};

/// A long streak fits much that is no ball.
double least_explained(const BallOutline& ball) {
  const double radii = ball.streak_px.norm() / ball.radius_px;
  return min_explained + std::min(1.0, 0.25 * radii) * (min_streak_explained - min_explained);
}

/// Specks that flicker are many; of what is larger, the rounder the better.
double promise_of(double area_px, double roundness) {
  return std::min(1.0, area_px / speck_area_px2) * roundness;
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
  BlobFinder blob_finder;
  InscribedDiscs inscribed_discs;
  ExpectedBalls expected_balls;
  BallFit ball_fit;
  BallSignal signal;
  cv::Mat mask;
  std::vector<PixelRun> changed;
  std::vector<Start> starts;
  std::vector<KnownBall> balls;  ///< of the sightings
  FrameSightings found;
  View view = View::learning;
  std::uint64_t count = 0;

  State(const CameraModel& lens, double diameter_m, const BallDetectorSettings& with)
      : model(lens),
        ball_diameter_m(diameter_m),
        settings(with),
        background(lens.width_px, lens.height_px, with.threshold_sigmas),
        expected_balls(diameter_m, static_cast<std::size_t>(with.max_sightings)),
        signal(with.ball_colour),
        mask(lens.height_px, lens.width_px, CV_8U) {
    // Memory for a busy picture is taken now: later a frame takes none.
    const std::size_t runs = mask.total() / 16 + 64;
    changed.reserve(runs);
    blob_finder.reserve(runs);
    inscribed_discs.reserve(max_parted_px2);
    starts.reserve(256);
    balls.reserve(static_cast<std::size_t>(settings.max_sightings));
    found.sightings.reserve(static_cast<std::size_t>(settings.max_sightings));
  }

  bool is_cut(const Blob& blob) const;
  std::optional<BallOutline> outline_of(const Blob& blob) const;
  std::optional<BallOutline> outline_of_cut(const cv::Mat& grey, const Blob& blob);
  void add_parts(const cv::Mat& grey, const Blob& whole);
  void find_starts(const cv::Mat& grey, const std::vector<KnownBall>& expected);
  View look(const Frame& frame);
  void try_start(const cv::Mat& grey, const Start& start);
  bool is_cut(const BallOutline& outline) const;
  bool is_doubtful(const FittedBall& ball) const;
  bool is_found(const BallOutline& outline) const;
};

/// Whether the picture's edge may hide a part of a blob.
bool BallDetector::State::is_cut(const Blob& blob) const {
  const cv::Rect inside(1, 1, model.width_px - 2, model.height_px - 2);
  return (blob.box & inside) != blob.box;
}

/// A first guess at the ball from a blob's moments, or nothing where it cannot be one. A disc of
/// radius r that moves by s has the moments r^2/4 across and r^2/4 + s^2/12 along.
std::optional<BallOutline> BallDetector::State::outline_of(const Blob& blob) const {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> spread(
      blob.spread_px2 + Eigen::Matrix2d::Identity() / 12);  // a pixel's own
  const double across = spread.eigenvalues()[0], along = spread.eigenvalues()[1];
  const double radius_px = 2 * std::sqrt(across);
  if (radius_px < settings.min_radius_px || radius_px > settings.max_radius_px) return std::nullopt;
  if (along > max_elongation * max_elongation * across) return std::nullopt;
  if (blob.area_px < min_filled * 4 * std::numbers::pi * std::sqrt(along * across))
    return std::nullopt;
  return BallOutline{blob.centroid_px, radius_px,
                     std::sqrt(12 * (along - across)) * spread.eigenvectors().col(1)};
}

/// The circle through a blob's rim where the picture's edge does not cut it (least squares, after
/// Kasa: |p|^2 = 2 c p + (r^2 - |c|^2)).
std::optional<BallOutline> BallDetector::State::outline_of_cut(const cv::Mat& grey,
                                                               const Blob& blob) {
  const cv::Rect& box = blob.box;
  if (box.area() > max_parted_px2) return std::nullopt;
  cv::Mat marked = mask(box);
  background.mark(grey, box, marked);
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  const auto add = [&](double x, double y) {
    const bool is_rim = box.x + x > 0.5 && box.x + x < model.width_px - 1.5 && box.y + y > 0.5 &&
                        box.y + y < model.height_px - 1.5;
    if (!is_rim) return;
    const Eigen::Vector3d row(2 * x, 2 * y, 1);
    normal += row * row.transpose();
    right += (x * x + y * y) * row;
  };
  for (int y = 0; y < box.height; ++y) {
    int first = 0, last = box.width - 1;
    while (first < box.width && !marked.at<std::uint8_t>(y, first)) ++first;
    while (last > first && !marked.at<std::uint8_t>(y, last)) --last;
    if (first == box.width) continue;
    add(first - 0.5, y);
    add(last + 0.5, y);
  }
  for (int x = 0; x < box.width; ++x) {
    int first = 0, last = box.height - 1;
    while (first < box.height && !marked.at<std::uint8_t>(first, x)) ++first;
    while (last > first && !marked.at<std::uint8_t>(last, x)) --last;
    if (first == box.height) continue;
    add(x, first - 0.5);
    add(x, last + 0.5);
  }
  const Eigen::LDLT<Eigen::Matrix3d> factors(normal);
  if (factors.info() != Eigen::Success || factors.rcond() < 1e-9) return std::nullopt;
  const Eigen::Vector3d circle = factors.solve(right);
  const double radius_px = std::sqrt(std::max(0.0, circle[2] + circle.head<2>().squaredNorm()));
  const bool is_possible = radius_px >= settings.min_radius_px &&
                           radius_px <= settings.max_radius_px &&
                           blob.area_px > min_seen * std::numbers::pi * radius_px * radius_px &&
                           blob.area_px < 1.3 * std::numbers::pi * radius_px * radius_px;
  if (!is_possible) return std::nullopt;
  return BallOutline{circle.head<2>() + Eigen::Vector2d(box.x, box.y), radius_px, {0, 0}};
}

/// A ball that still touches the hand that threw it: a round end of the blob.
void BallDetector::State::add_parts(const cv::Mat& grey, const Blob& whole) {
  const cv::Rect& box = whole.box;
  const double least_px = 2 * settings.min_radius_px;
  if (box.width < least_px || box.height < least_px || box.area() > max_parted_px2) return;
  cv::Mat marked = mask(box);
  background.mark(grey, box, marked);
  std::size_t parts = 0;
  for (const InscribedDisc& disc : inscribed_discs.find(marked, settings.min_radius_px)) {
    if (disc.radius_px > settings.max_radius_px) continue;
    const Eigen::Vector2d corner(box.x, box.y);
    starts.push_back(
        {{corner + disc.centre_px, disc.radius_px, {0, 0}},
         promise_of(std::numbers::pi * disc.radius_px * disc.radius_px, disc.free_share - 0.3)});
    if (++parts == max_parts) return;
  }
}

/// Where a ball may be: what is expected first, then what is round, then round ends.
void BallDetector::State::find_starts(const cv::Mat& grey, const std::vector<KnownBall>& expected) {
  starts.clear();
  const double min_area_px = min_filled * std::numbers::pi * std::pow(settings.min_radius_px, 2);
  for (const Blob& blob : blob_finder.find(changed, std::max(1, static_cast<int>(min_area_px)))) {
    if (is_cut(blob)) {
      if (const auto outline = outline_of_cut(grey, blob))
        starts.push_back({*outline, promise_of(blob.area_px, 0.5)});
    } else if (const auto outline = outline_of(blob)) {
      const double round = outline->radius_px / (outline->radius_px + outline->streak_px.norm());
      starts.push_back({*outline, promise_of(blob.area_px, 0.5 + 0.5 * round)});
    } else {
      add_parts(grey, blob);
    }
  }
  for (Start& start : starts)
    for (const KnownBall& ball : expected) {
      const double off_px = (start.outline.centre_px - ball.outline.centre_px).norm();
      if (off_px > ball.outline.radius_px + expected_px) continue;
      if (!start.expected) start.promise += 2;
      start.expected = &ball;
    }
  std::ranges::sort(starts, std::greater<>(), [](const Start& start) {
    return std::tuple(start.promise, start.outline.centre_px.y(), start.outline.centre_px.x());
  });
  if (starts.size() > max_fits) starts.resize(max_fits);
}

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
  find_starts(grey, expected);
  const long enough = ball_fit.work() + max_work;
  for (const Start& start : starts)
    if (start.expected || ball_fit.work() < enough) try_start(grey, start);
  // One that was seen flying and is not, now: it may stand before something as bright as itself.
  for (const KnownBall& ball : expected) try_start(grey, {ball.outline, 0.0, &ball});
  expected_balls.add(found.time, balls);
  return background.is_shaken() ? View::shaken : View::clear;
}

void BallDetector::State::try_start(const cv::Mat& grey, const Start& start) {
  if (found.sightings.size() >= static_cast<std::size_t>(settings.max_sightings)) return;
  if (is_found(start.outline)) return;
  const auto form =
      sphere_outline(model, ball_diameter_m, start.outline.centre_px, start.outline.radius_px);
  if (!form) return;
  auto ball = ball_fit.fit(grey, background, form->shape, start.outline);
  bool is_partial = ball && is_doubtful(*ball);
  KnownBall known;
  if (const KnownBall* expected = start.expected) {
    // What hides a part of a ball makes it look smaller and elsewhere, and fits no worse. Where it
    // stays smaller, the frames before were wrong.
    const bool is_small =
        ball && !is_partial && ball->outline.radius_px < min_shrink * expected->outline.radius_px;
    known.shrunk_frames = is_small ? expected->shrunk_frames + 1 : 0;
    is_partial |= is_small && known.shrunk_frames <= max_shrunk_frames;
    if (!ball || is_partial)
      if (const auto other =
              ball_fit.fit(grey, background, form->shape, expected->outline, &expected->outline))
        ball = other;
  }
  if (!ball || ball->explained < least_explained(ball->outline) || is_found(ball->outline)) return;
  if (start.expected && !is_like(ball->outline, start.expected->outline)) return;
  const auto outline =
      sphere_outline(model, ball_diameter_m, ball->outline.centre_px, ball->outline.radius_px);
  if (!outline) return;
  BallSighting sighting;
  sighting.camera = found.camera;
  sighting.time = found.time;
  sighting.radius_px = ball->outline.radius_px;
  sighting.center_px = ball->outline.centre_px - outline->offset_px;
  sighting.is_partial = is_partial;
  double sigma_px = std::hypot(sigma_model_px, sigma_streak * ball->outline.streak_px.norm());
  if (is_partial) {
    known.was_whole = start.expected && start.expected->was_whole;
    sigma_px = std::max(
        sigma_px, (known.was_whole ? sigma_expected : sigma_doubtful) * ball->outline.radius_px);
  }
  if (is_cut(ball->outline)) sigma_px = std::max(sigma_px, sigma_cut * ball->outline.radius_px);
  sighting.cov_px2 = ball->cov_centre_px2 + sigma_px * sigma_px * Eigen::Matrix2d::Identity();
  sighting.id = (static_cast<std::uint64_t>(found.camera) << 40) + count++;
  found.sightings.push_back(sighting);
  known.outline = ball->outline;
  if (is_partial && start.expected) {  // the next frame had better believe those before
    known.outline.radius_px = start.expected->outline.radius_px;
    known.outline.streak_px = start.expected->outline.streak_px;
  }
  balls.push_back(known);
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
