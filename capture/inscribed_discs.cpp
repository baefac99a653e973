// SPDX-License-Identifier: BSD-3-Clause
#include "capture/inscribed_discs.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <tuple>

namespace throwcal {
namespace {

/// Chamfer distances of a step aside, a diagonal one and a knight's move, in fifths of a pixel:
/// right to 2 %.
constexpr std::int32_t aside = 5, diagonal = 7, knight = 11, far = 1 << 20;
constexpr int rim_points = 32;
constexpr double outside_px = 1.6;       ///< where the rim is looked at, beyond the disc
constexpr double min_free_share = 0.55;  ///< an arm leaves less than half of the rim free
constexpr double apart_radii = 0.6;      ///< nearer than that two discs are one
constexpr std::size_t max_peaks = 64;

}  // namespace

void InscribedDiscs::reserve(std::size_t pixels) {
  distances_.reserve(2 * pixels);
  peaks_.reserve(pixels / 8);
  discs_.reserve(max_peaks);
}

/// Distances to the nearest pixel that is not marked; what is beyond the picture is not.
void InscribedDiscs::measure_distances(const cv::Mat& marked) {
  width_ = marked.cols + 4;  // a border of two, so that no step leaves the memory
  height_ = marked.rows + 4;
  distances_.assign(static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_), 0);
  for (int y = 0; y < marked.rows; ++y)
    for (int x = 0; x < marked.cols; ++x)
      if (marked.at<std::uint8_t>(y, x))
        distances_[static_cast<std::size_t>((y + 2) * width_ + x + 2)] = far;
  const auto relax = [&](int y, int x, int sign) {
    const auto at = static_cast<std::ptrdiff_t>(y) * width_ + x;
    auto& here = distances_[static_cast<std::size_t>(at)];
    if (here == 0) return;
    const auto from = [&](int dx, int dy, std::int32_t cost) {
      const auto other = at + sign * (static_cast<std::ptrdiff_t>(dy) * width_ + dx);
      here = std::min(here, distances_[static_cast<std::size_t>(other)] + cost);
    };
    from(-1, 0, aside), from(0, -1, aside);
    from(-1, -1, diagonal), from(1, -1, diagonal);
    from(-2, -1, knight), from(2, -1, knight), from(-1, -2, knight), from(1, -2, knight);
  };
  for (int y = 2; y < height_ - 2; ++y)
    for (int x = 2; x < width_ - 2; ++x) relax(y, x, 1);
  for (int y = height_ - 3; y >= 2; --y)
    for (int x = width_ - 3; x >= 2; --x) relax(y, x, -1);
}

double InscribedDiscs::distance_px(int x, int y) const {
  return 0.2 * distances_[static_cast<std::size_t>((y + 2) * width_ + x + 2)];
}

double InscribedDiscs::free_share(const cv::Mat& marked, const InscribedDisc& disc) const {
  const double reach = disc.radius_px + outside_px;
  int free = 0;
  for (int i = 0; i < rim_points; ++i) {
    const double turn = 2 * std::numbers::pi * i / rim_points;
    const int x = cvRound(disc.centre_px.x() + reach * std::cos(turn));
    const int y = cvRound(disc.centre_px.y() + reach * std::sin(turn));
    const bool is_inside = x >= 0 && y >= 0 && x < marked.cols && y < marked.rows;
    free += !is_inside || !marked.at<std::uint8_t>(y, x);
  }
  return static_cast<double>(free) / rim_points;
}

const std::vector<InscribedDisc>& InscribedDiscs::find(const cv::Mat& marked,
                                                       double min_radius_px) {
  measure_distances(marked);
  peaks_.clear();
  for (int y = 0; y < marked.rows; ++y)
    for (int x = 0; x < marked.cols; ++x) {
      // The nearest unmarked pixel's centre is half a pixel beyond the border.
      const double radius = distance_px(x, y) - 0.5;
      if (radius < min_radius_px) continue;
      bool is_peak = true;
      for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx)
          is_peak &= distance_px(x, y) >= distance_px(x + dx, y + dy);
      if (is_peak) peaks_.push_back({{x, y}, radius, 0.0});
    }
  for (InscribedDisc& peak : peaks_) peak.free_share = free_share(marked, peak);
  std::erase_if(peaks_, [](const auto& peak) { return peak.free_share < min_free_share; });
  std::ranges::sort(peaks_, std::greater<>(), [](const InscribedDisc& peak) {
    return std::tuple(peak.free_share, peak.centre_px.y(), peak.centre_px.x());
  });
  if (peaks_.size() > max_peaks) peaks_.resize(max_peaks);
  discs_.clear();
  for (const InscribedDisc& peak : peaks_) {
    const auto is_same = [&](const InscribedDisc& disc) {
      return (disc.centre_px - peak.centre_px).norm() < apart_radii * disc.radius_px;
    };
    if (std::ranges::none_of(discs_, is_same)) discs_.push_back(peak);
  }
  return discs_;
}

}  // namespace throwcal
