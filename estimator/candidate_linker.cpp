// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/candidate_linker.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "estimator/elementary.h"

namespace throwcal {
namespace {

constexpr std::int64_t max_start_gap = 3, max_gap = 6;  // frames
constexpr double max_pause_s = 0.3;
constexpr std::size_t fit_points = 6;
constexpr double gate_sigmas = 4.5;
constexpr double slack_px = 1.0;  // what a quadratic over six frames leaves of a thrown ball
constexpr double max_speed_mps = 12.0;
constexpr double nearest_m = 0.7;  // where the apparent radius is not known
constexpr double max_acceleration_mps2 = 25.0;
constexpr double still_px = 1.0;  // over a triplet: what rests is not in flight
constexpr std::size_t max_live = 60;

double sigma_px(const Candidate& c) { return std::sqrt(0.5 * c.sighting.cov_px2.trace()); }

/// Quadratic through the last points of a tracklet, pixels over time.
struct Quadratic {
  double origin_s = 0.0;
  Eigen::Matrix<double, 3, 2> coefficients;
  Eigen::Matrix3d cofactor;  ///< covariance of one coordinate's coefficients at unit noise

  Quadratic(const CandidateHistory& history, const std::vector<CandidateRef>& points) {
    const std::size_t n = std::min(points.size(), fit_points), first = points.size() - n;
    origin_s = history.at(points.back()).ray.time_s;
    const double scale_s = history.frame_interval_s();
    Eigen::Matrix3d M = Eigen::Matrix3d::Zero();
    Eigen::Matrix<double, 3, 2> b = Eigen::Matrix<double, 3, 2>::Zero();
    for (std::size_t i = first; i < points.size(); ++i) {
      const Candidate& c = history.at(points[i]);
      const Eigen::Vector3d row = powers((c.ray.time_s - origin_s) / scale_s);
      M += row * row.transpose();
      b += row * c.sighting.center_px.transpose();
    }
    cofactor = M.inverse();
    coefficients = cofactor * b;
    scale_s_ = scale_s;
  }

  static Eigen::Vector3d powers(double t) { return {1.0, t, t * t}; }

  /// How far a candidate lies from the continuation, in units of the gate (1: at its edge).
  double misfit(const Candidate& c) const {
    const Eigen::Vector3d row = powers((c.ray.time_s - origin_s) / scale_s_);
    const Eigen::Vector2d error = c.sighting.center_px - coefficients.transpose() * row;
    const double sigma = sigma_px(c) * std::sqrt(1.0 + row.dot(cofactor * row));
    return error.norm() / (gate_sigmas * sigma + slack_px);
  }

 private:
  double scale_s_ = 1.0;
};

/// Whether three candidates may be one ball: speed and acceleration, as angles at its distance.
bool may_be_one(const Candidate& a, const Candidate& b, const Candidate& c) {
  if ((c.sighting.center_px - a.sighting.center_px).norm() < still_px) return false;
  const double ab_s = b.ray.time_s - a.ray.time_s, bc_s = c.ray.time_s - b.ray.time_s;
  if (ab_s <= 0 || bc_s <= 0) return false;
  double range_m = nearest_m;
  if (a.range_m && b.range_m && c.range_m) {
    // The head of the list of three is the median; noise and a flash may spoil one of them.
    std::array<double, 3> ranges{*a.range_m, *b.range_m, *c.range_m};
    std::sort(ranges.begin(), ranges.end());
    if (ranges[2] > 2.5 * ranges[0]) return false;
    range_m = 0.7 * ranges[1];
  }
  const Eigen::Vector3d ab = (b.ray.direction_cam - a.ray.direction_cam) / ab_s;
  const Eigen::Vector3d bc = (c.ray.direction_cam - b.ray.direction_cam) / bc_s;
  const double max_rate = max_speed_mps / range_m;
  if (ab.norm() > max_rate || bc.norm() > max_rate) return false;
  const double angle_noise = 4.0 / std::max(b.ray.whitener.norm(), 1.0);
  const double change = (bc - ab).norm() / (0.5 * (ab_s + bc_s));
  // Perspective turns speed towards the camera into apparent acceleration: 2 v^2 / r^2 at most.
  return change <
         max_acceleration_mps2 / range_m + 2 * square(ab.norm()) + 4 * angle_noise / (ab_s * bc_s);
}

}  // namespace

void CandidateLinker::add(const CandidateHistory& history) {
  const CandidateFrame& newest = history.frame(history.end_frame() - 1);
  std::vector<bool> claimed(newest.candidates.size(), false);
  // A pause in the stream ends whatever moved before it, and its frames may be gone.
  std::erase_if(live_, [&](Tracklet& tracklet) {
    const std::size_t n = std::min(tracklet.points.size(), fit_points);
    const bool held = history.holds(tracklet.points[tracklet.points.size() - n]);
    const bool paused =
        !held || newest.time_s - history.frame(tracklet.points.back().frame).time_s > max_pause_s;
    if (paused && tracklet.points.size() > fit_points) ended_.push_back(std::move(tracklet));
    return paused;
  });
  extend(history, claimed);
  start(history, claimed);
  end_stale(history);
}

void CandidateLinker::extend(const CandidateHistory& history, std::vector<bool>& claimed) {
  const std::int64_t frame = history.end_frame() - 1;
  const CandidateFrame& newest = history.frame(frame);
  for (Tracklet& tracklet : live_) {
    if (newest.candidates.empty()) break;
    const Quadratic path(history, tracklet.points);
    std::size_t nearest = 0;
    double least = 1.0;
    for (std::size_t i = 0; i < newest.candidates.size(); ++i) {
      const double misfit = path.misfit(newest.candidates[i]);
      if (misfit >= least) continue;
      least = misfit;
      nearest = i + 1;
    }
    if (nearest == 0) continue;
    tracklet.points.push_back({frame, nearest - 1});
    if (tracklet.points.size() > fit_points) claimed[nearest - 1] = true;
  }
}

void CandidateLinker::start(const CandidateHistory& history, const std::vector<bool>& claimed) {
  const std::int64_t last = history.end_frame() - 1;
  const CandidateFrame& newest = history.frame(last);
  for (std::size_t c = 0; c < newest.candidates.size(); ++c) {
    if (claimed[c]) continue;
    for (std::int64_t middle = last - 1;
         middle >= std::max(last - max_start_gap, history.begin_frame()); --middle)
      for (std::size_t b = 0; b < history.frame(middle).candidates.size(); ++b)
        for (std::int64_t first = middle - 1;
             first >= std::max(middle - max_start_gap, history.begin_frame()); --first)
          for (std::size_t a = 0; a < history.frame(first).candidates.size(); ++a) {
            if (live_.size() >= max_live) return;
            if (may_be_one(history.frame(first).candidates[a], history.frame(middle).candidates[b],
                           newest.candidates[c]))
              live_.push_back({{{first, a}, {middle, b}, {last, c}}});
          }
  }
}

void CandidateLinker::end_stale(const CandidateHistory& history) {
  const std::int64_t now = history.end_frame() - 1;
  // Of tracklets with the same last three points, the longest stays.
  std::stable_sort(live_.begin(), live_.end(), [](const Tracklet& a, const Tracklet& b) {
    return a.points.size() > b.points.size();
  });
  std::vector<Tracklet> kept;
  for (Tracklet& tracklet : live_) {
    const bool same = std::any_of(kept.begin(), kept.end(), [&](const Tracklet& other) {
      return std::equal(tracklet.points.end() - 3, tracklet.points.end(), other.points.end() - 3);
    });
    // A young tracklet that misses twice was chance; an old one may pass behind a post.
    const std::int64_t patience = std::min<std::int64_t>(max_gap, std::ssize(tracklet.points) - 1);
    const bool lost = now - tracklet.points.back().frame > patience;
    if (!same && !lost)
      kept.push_back(std::move(tracklet));
    else if (!same && tracklet.points.size() > fit_points)
      ended_.push_back(std::move(tracklet));
  }
  live_ = std::move(kept);
}

std::vector<Tracklet> CandidateLinker::drain_ended() { return std::exchange(ended_, {}); }

}  // namespace throwcal
