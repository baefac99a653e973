// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/candidate_history.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "estimator/ray_fit.h"

namespace throwcal {
namespace {

constexpr double kept_s = 60.0;
constexpr std::size_t kept_candidates = 40000;  // 12 MB, whatever the clutter
// More blobs than this in a frame are a light switched on, not balls.
constexpr std::size_t max_candidates_a_frame = 64;

double median(std::deque<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

std::optional<double> apparent_radius_px(const CameraModel& model, const Eigen::Vector3d& point_cam,
                                         double ball_diameter_m) {
  Eigen::Matrix<double, 2, 3> J;
  if (!model.project(point_cam, &J)) return std::nullopt;
  const Eigen::Matrix2d across = J * tangents(point_cam);
  return 0.5 * ball_diameter_m * std::sqrt(std::abs(across.determinant()));
}

bool CandidateHistory::add(const FrameSightings& frame) {
  if (frames_.empty() && first_ == 0) epoch_ = frame.time;
  const double time_s = seconds(frame.time - epoch_);
  if (!frames_.empty()) {
    const double step_s = time_s - frames_.back().time_s;
    if (step_s <= 0) return false;
    recent_intervals_s_.push_back(step_s);
    if (recent_intervals_s_.size() > 31) recent_intervals_s_.pop_front();
    interval_s_ = std::clamp(median(recent_intervals_s_), 1e-3, 0.1);
  }
  CandidateFrame out{time_s, {}};
  for (const BallSighting& sighting : frame.sightings) {
    if (out.candidates.size() == max_candidates_a_frame) break;
    const auto ray = timed_ray(model_, sighting, epoch_);
    if (!ray) continue;
    Candidate candidate{sighting, *ray, std::nullopt};
    // At unit range the apparent radius is its largest; it falls with range.
    const auto unit = apparent_radius_px(model_, ray->direction_cam, ball_diameter_m_);
    if (unit && sighting.radius_px && *sighting.radius_px > 0)
      candidate.range_m = *unit / *sighting.radius_px;
    out.candidates.push_back(candidate);
  }
  candidate_count_ += out.candidates.size();
  frames_.push_back(std::move(out));
  while (time_s - frames_.front().time_s > kept_s || candidate_count_ > kept_candidates) {
    candidate_count_ -= frames_.front().candidates.size();
    frames_.pop_front();
    ++first_;
  }
  return true;
}

}  // namespace throwcal
