// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/noise_estimate.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace throwcal {
namespace {

constexpr std::size_t kept = 800, enough = 24;
constexpr double moving_px = 4.0;  // over five frames
constexpr double median_abs_normal = 0.67448975;

}  // namespace

void NoiseEstimate::add(const CandidateHistory& history, Tracklet& tracklet) {
  const std::vector<CandidateRef>& points = tracklet.points;
  for (std::size_t i = std::max<std::size_t>(tracklet.measured_until, 4); i < points.size(); ++i) {
    tracklet.measured_until = i + 1;
    const std::array<CandidateRef, 5> five{points[i - 4], points[i - 3], points[i - 2],
                                           points[i - 1], points[i]};
    if (five[4].frame - five[0].frame != 4 || !history.holds(five[0])) continue;
    // Frames in which nothing was seen may be missing from a recording.
    const double span_s = history.frame(five[4].frame).time_s - history.frame(five[0].frame).time_s;
    if (std::abs(span_s - 4 * history.frame_interval_s()) > 0.4 * history.frame_interval_s())
      continue;
    const auto pixel = [&](std::size_t k) { return history.at(five[k]).sighting.center_px; };
    if ((pixel(4) - pixel(0)).norm() < moving_px) continue;
    const Eigen::Vector2d fourth = pixel(0) - 4 * pixel(1) + 6 * pixel(2) - 4 * pixel(3) + pixel(4);
    const double sigma = std::sqrt(0.5 * history.at(five[2]).sighting.cov_px2.trace());
    for (const double d : fourth) ratios_.push_back(std::abs(d) / (std::sqrt(70.0) * sigma));
  }
  while (ratios_.size() > kept) ratios_.pop_front();
}

std::optional<double> NoiseEstimate::scale() const {
  if (ratios_.size() < enough) return std::nullopt;
  std::deque<double> sorted = ratios_;
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
  std::nth_element(sorted.begin(), middle, sorted.end());
  return *middle / median_abs_normal;
}

}  // namespace throwcal
