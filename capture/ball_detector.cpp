// SPDX-License-Identifier: BSD-3-Clause
#include "capture/ball_detector.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "capture/background.h"
#include "capture/ball_fit.h"
#include "capture/blobs.h"
#include "capture/sphere_outline.h"

namespace throwcal {
namespace {

constexpr double max_elongation = 4.0;       ///< a streak of a fast ball, not an arm or an edge
constexpr double max_part_elongation = 1.6;  ///< within a blob that is no ball: less is believed
constexpr double min_filled = 0.6;           ///< of the ellipse of its moments
constexpr double min_explained = 0.7;
constexpr int max_parted_px2 = 40000;         ///< of a blob's box: an arm, not a person
constexpr std::size_t fits_per_sighting = 3;  ///< bounds the time that a busy picture takes
/// What the model leaves out: felt, the lens' own blur, the rounding of motion to a straight line.
constexpr double sigma_model_px = 0.01;

/// Brightness of a picture of any format; `converted` holds it where it has to be computed.
cv::Mat luma(const ImageView& image, cv::Mat& converted) {
  auto* data = const_cast<std::uint8_t*>(image.data);  // cv::Mat has no view of const
  const auto view = [&](int type) {
    return cv::Mat(image.height_px, image.width_px, type, data, image.stride_bytes);
  };
  switch (image.format) {
    case PixelFormat::grey:
    case PixelFormat::nv12:  // its luma comes first
      return view(CV_8UC1);
    case PixelFormat::yuyv:
      cv::extractChannel(view(CV_8UC2), converted, 0);
      return converted;
    case PixelFormat::bgr:
      cv::cvtColor(view(CV_8UC3), converted, cv::COLOR_BGR2GRAY);
      return converted;
  }
  return {};
}

}  // namespace

struct BallDetector::State {
  CameraModel model;
  double ball_diameter_m;
  BallDetectorSettings settings;
  Background background;
  BlobFinder blob_finder, part_finder;
  BallFit ball_fit;
  cv::Mat converted, changed, strength, strong;
  std::vector<Blob> candidates;
  std::uint64_t count = 0;

  State(const CameraModel& lens, double diameter_m, const BallDetectorSettings& with)
      : model(lens),
        ball_diameter_m(diameter_m),
        settings(with),
        background(lens.width_px, lens.height_px, with.threshold_sigmas),
        changed(lens.height_px, lens.width_px, CV_8U),
        strength(lens.height_px, lens.width_px, CV_8U),
        strong(lens.height_px, lens.width_px, CV_8U) {}

  std::optional<BallOutline> outline_of(const Blob& blob, double elongation = max_elongation) const;
  void choose_candidates(const cv::Mat& grey);
  void add_parts(const cv::Mat& grey, const Blob& whole);
  std::optional<BallSighting> measure(const cv::Mat& grey, const Blob& blob);
};

/// A first guess at the ball from a blob's moments, or nothing where it cannot be one. A disc of
/// radius r that moves by s has the moments r^2/4 across and r^2/4 + s^2/12 along.
std::optional<BallOutline> BallDetector::State::outline_of(const Blob& blob,
                                                           double elongation) const {
  const cv::Rect inside(1, 1, model.width_px - 2, model.height_px - 2);
  if ((blob.box & inside) != blob.box) return std::nullopt;  // cut by the picture's edge
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> spread(
      blob.spread_px2 + Eigen::Matrix2d::Identity() / 12);  // a pixel's own
  const double across = spread.eigenvalues()[0], along = spread.eigenvalues()[1];
  const double radius_px = 2 * std::sqrt(across);
  if (radius_px < settings.min_radius_px || radius_px > settings.max_radius_px) return std::nullopt;
  if (along > elongation * elongation * across) return std::nullopt;
  if (blob.area_px < min_filled * 4 * std::numbers::pi * std::sqrt(along * across))
    return std::nullopt;
  return BallOutline{blob.centroid_px, radius_px,
                     std::sqrt(12 * (along - across)) * spread.eigenvectors().col(1)};
}

void BallDetector::State::choose_candidates(const cv::Mat& grey) {
  candidates.clear();
  const double min_area_px = min_filled * std::numbers::pi * std::pow(settings.min_radius_px, 2);
  for (const Blob& blob : blob_finder.find(changed, std::max(1, static_cast<int>(min_area_px)))) {
    if (outline_of(blob))
      candidates.push_back(blob);
    else
      add_parts(grey, blob);
  }
  const std::size_t most = fits_per_sighting * static_cast<std::size_t>(settings.max_sightings);
  if (candidates.size() <= most) return;
  std::ranges::nth_element(candidates, candidates.begin() + static_cast<std::ptrdiff_t>(most),
                           std::greater<>(), &Blob::area_px);
  candidates.resize(most);
}

/// A ball that still touches the hand that threw it: where it stands out more than the rest, a
/// higher threshold parts them. Of several thresholds the lowest that does so is taken.
void BallDetector::State::add_parts(const cv::Mat& grey, const Blob& whole) {
  const cv::Rect& box = whole.box;
  const double radius_px = settings.min_radius_px;
  if (box.width < 2 * radius_px || box.height < 2 * radius_px || box.area() > max_parted_px2)
    return;
  cv::Mat region = strength(box), mask = strong(box);
  background.difference(grey, box, region);
  double strongest = 0;
  cv::minMaxLoc(region, nullptr, &strongest);
  const std::size_t before = candidates.size();
  for (const double share : {0.35, 0.5, 0.65, 0.8}) {
    cv::compare(region, share * strongest, mask, cv::CMP_GT);
    for (Blob part : part_finder.find(mask, 4)) {
      part.box += box.tl();
      part.centroid_px += Eigen::Vector2d(box.x, box.y);
      if (outline_of(part, max_part_elongation)) candidates.push_back(part);
    }
    if (candidates.size() > before) return;
  }
}

std::optional<BallSighting> BallDetector::State::measure(const cv::Mat& grey, const Blob& blob) {
  const auto start = outline_of(blob);
  const auto form = sphere_outline(model, ball_diameter_m, start->centre_px, start->radius_px);
  if (!form) return std::nullopt;
  const auto ball = ball_fit.fit(grey, background, form->shape, *start);
  if (!ball || ball->explained < min_explained) return std::nullopt;
  const auto outline =
      sphere_outline(model, ball_diameter_m, ball->outline.centre_px, ball->outline.radius_px);
  if (!outline) return std::nullopt;
  BallSighting sighting;
  sighting.center_px = ball->outline.centre_px - outline->offset_px;
  sighting.cov_px2 =
      ball->cov_centre_px2 + sigma_model_px * sigma_model_px * Eigen::Matrix2d::Identity();
  sighting.radius_px = ball->outline.radius_px;
  return sighting;
}

BallDetector::BallDetector(CameraModel model, double ball_diameter_m, BallDetectorSettings settings)
    : state_(std::make_unique<State>(model, ball_diameter_m, settings)) {}
BallDetector::~BallDetector() = default;
BallDetector::BallDetector(BallDetector&&) noexcept = default;

FrameSightings BallDetector::detect(const Frame& frame) {
  State& s = *state_;
  FrameSightings found{frame.camera, frame.row0_mid_exposure, {}};
  const cv::Mat grey = luma(frame.image, s.converted);
  if (!s.background.compare_and_learn(grey, s.changed)) return found;
  s.choose_candidates(grey);
  for (const Blob& blob : s.candidates) {
    auto sighting = s.measure(grey, blob);
    if (!sighting) continue;
    sighting->camera = frame.camera;
    sighting->time = frame.row0_mid_exposure;
    // Unique over the cameras of a rig, too.
    sighting->id = (static_cast<std::uint64_t>(frame.camera) << 40) + s.count++;
    found.sightings.push_back(std::move(*sighting));
    if (found.sightings.size() == static_cast<std::size_t>(s.settings.max_sightings)) break;
  }
  return found;
}

}  // namespace throwcal
