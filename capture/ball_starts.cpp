// SPDX-License-Identifier: BSD-3-Clause
#include "capture/ball_starts.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <tuple>

namespace throwcal {
namespace {

constexpr double max_elongation = 4.0;  ///< a streak of a fast ball, not an arm or an edge
constexpr double min_filled = 0.6;      ///< of the ellipse of its moments
constexpr int max_parted_px2 = 40000;   ///< of a blob's box: an arm, not a person
constexpr std::size_t max_parts = 3;    ///< of one blob
constexpr std::size_t max_starts = 32;  ///< bounds the time that a busy picture takes
constexpr double min_seen = 0.3;        ///< of a ball that the picture's edge cuts
constexpr double most_filled = 1.3;     ///< of its disc
constexpr double expected_px = 2.0;     ///< and a radius: how near is as expected
constexpr double speck_area_px2 = 28.0;

/// Specks that flicker are many; of what is larger, the rounder the better.
double promise_of(double area_px, double roundness) {
  return std::min(1.0, area_px / speck_area_px2) * roundness;
}

}  // namespace

BallStarts::BallStarts(int width_px, int height_px, double min_radius_px, double max_radius_px)
    : min_radius_px_(min_radius_px),
      max_radius_px_(max_radius_px),
      mask_(height_px, width_px, CV_8U) {
  // Memory for a busy picture is taken now: later a frame takes none.
  blob_finder_.reserve(mask_.total() / 16 + 64);
  inscribed_discs_.reserve(max_parted_px2);
  starts_.reserve(256);
}

/// Whether the picture's edge may hide a part of a blob.
bool BallStarts::is_cut(const Blob& blob) const {
  const cv::Rect inside(1, 1, mask_.cols - 2, mask_.rows - 2);
  return (blob.box & inside) != blob.box;
}

bool BallStarts::is_possible(double radius_px) const {
  return radius_px >= min_radius_px_ && radius_px <= max_radius_px_;
}

/// A first guess at the ball from a blob's moments, or nothing where it cannot be one. A disc of
/// radius r that moves by s has the moments r^2/4 across and r^2/4 + s^2/12 along.
std::optional<BallOutline> BallStarts::outline_of(const Blob& blob) const {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> spread(
      blob.spread_px2 + Eigen::Matrix2d::Identity() / 12);  // a pixel's own
  const double across = spread.eigenvalues()[0], along = spread.eigenvalues()[1];
  const double radius_px = 2 * std::sqrt(across);
  if (!is_possible(radius_px)) return std::nullopt;
  if (along > max_elongation * max_elongation * across) return std::nullopt;
  if (blob.area_px < min_filled * 4 * std::numbers::pi * std::sqrt(along * across))
    return std::nullopt;
  return BallOutline{blob.centroid_px, radius_px,
                     std::sqrt(12 * (along - across)) * spread.eigenvectors().col(1)};
}

/// The circle through a blob's rim where the picture's edge does not cut it (least squares, after
/// Kasa: |p|^2 = 2 c p + (r^2 - |c|^2)).
std::optional<BallOutline> BallStarts::outline_of_cut(const cv::Mat& marked,
                                                      const Blob& blob) const {
  const cv::Rect& box = blob.box;
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  const auto add = [&](double x, double y) {
    const bool is_rim = box.x + x > 0.5 && box.x + x < mask_.cols - 1.5 && box.y + y > 0.5 &&
                        box.y + y < mask_.rows - 1.5;
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
  const double disc_px2 = std::numbers::pi * radius_px * radius_px;
  if (!is_possible(radius_px) || blob.area_px < min_seen * disc_px2 ||
      blob.area_px > most_filled * disc_px2)
    return std::nullopt;
  return BallOutline{circle.head<2>() + Eigen::Vector2d(box.x, box.y), radius_px, {0, 0}};
}

/// A ball that still touches the hand that threw it.
void BallStarts::add_round_ends(const cv::Mat& marked, const Blob& blob) {
  const cv::Rect& box = blob.box;
  std::size_t parts = 0;
  for (const InscribedDisc& disc : inscribed_discs_.find(marked, min_radius_px_)) {
    if (disc.radius_px > max_radius_px_) continue;
    const Eigen::Vector2d corner(box.x, box.y);
    starts_.push_back(
        {{corner + disc.centre_px, disc.radius_px, {0, 0}},
         promise_of(std::numbers::pi * disc.radius_px * disc.radius_px, disc.free_share - 0.3)});
    if (++parts == max_parts) return;
  }
}

const std::vector<BallStart>& BallStarts::find(const cv::Mat& grey, const Background& background,
                                               std::span<const PixelRun> changed,
                                               std::span<const KnownBall> expected) {
  starts_.clear();
  const double min_area_px = min_filled * std::numbers::pi * std::pow(min_radius_px_, 2);
  for (const Blob& blob : blob_finder_.find(changed, std::max(1, static_cast<int>(min_area_px)))) {
    const bool cut = is_cut(blob);
    const auto outline = cut ? std::nullopt : outline_of(blob);
    if (outline) {
      const double round = outline->radius_px / (outline->radius_px + outline->streak_px.norm());
      starts_.push_back({*outline, promise_of(blob.area_px, 0.5 + 0.5 * round)});
      continue;
    }
    const cv::Rect& box = blob.box;
    if (box.area() > max_parted_px2) continue;
    cv::Mat marked = mask_(box);
    background.mark(grey, box, marked);
    if (!cut && std::min(box.width, box.height) >= 2 * min_radius_px_)
      add_round_ends(marked, blob);
    else if (const auto circle = cut ? outline_of_cut(marked, blob) : std::nullopt)
      starts_.push_back({*circle, promise_of(blob.area_px, 0.5)});
  }
  for (BallStart& start : starts_)
    for (const KnownBall& ball : expected) {
      const double off_px = (start.outline.centre_px - ball.outline.centre_px).norm();
      if (off_px > ball.outline.radius_px + expected_px) continue;
      if (!start.expected) start.promise += 2;
      start.expected = &ball;
    }
  std::ranges::sort(starts_, std::greater<>(), [](const BallStart& start) {
    return std::tuple(start.promise, start.outline.centre_px.y(), start.outline.centre_px.x());
  });
  if (starts_.size() > max_starts) starts_.resize(max_starts);
  return starts_;
}

}  // namespace throwcal
