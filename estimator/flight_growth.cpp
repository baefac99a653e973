// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/flight_growth.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <iterator>

#include "estimator/elementary.h"

namespace throwcal {
namespace {

constexpr double beyond_intervals = 3.5, near_m = 0.25;  ///< a hand, a bounce: no farther off
constexpr double max_chi2_per_dof = 1.8;
constexpr double max_speed_mps = 12.0;
constexpr double max_relative_sigma_depth = 0.25;
constexpr double max_log_size_error = 0.35;  // apparent against expected; a walker's head is at 0.8
constexpr double gate_chi2 = 16.0;           // 4 sigma along the worse direction
constexpr double patience_s = 0.1;           // a flight is over after so long unseen
constexpr std::int64_t patience_frames = 6;
constexpr double max_pause_s = 0.3;  // whatever the number of frames
constexpr int max_growth_rounds = 30;
constexpr std::size_t bent_points = 4;  // of a hand, that a short flight's fit may swallow
constexpr double max_merge_gap_s = 0.15;
constexpr std::size_t min_points = 8;
// An end is dropped where it costs this many sigmas more than its degrees of freedom.
constexpr double excess_sigmas = 3.0;

/// By how much a candidate's errors exceed what it states.
double noise_factor(const FlightKnowledge& knowledge, const Candidate& candidate) {
  const double var_px2 = 0.5 * candidate.sighting.cov_px2.trace();
  return std::sqrt(square(knowledge.noise_scale) + square(knowledge.slow_error_px) / var_px2);
}

std::vector<TimedRay> rays_of(const CandidateHistory& history, std::span<const CandidateRef> points,
                              const FlightKnowledge& knowledge) {
  std::vector<TimedRay> out;
  out.reserve(points.size());
  for (const CandidateRef& ref : points) {
    out.push_back(history.at(ref).ray);
    out.back().whitener /= noise_factor(knowledge, history.at(ref));
  }
  return out;
}

FlightFitSettings settings_for(const FlightKnowledge& knowledge, bool drag_unknown) {
  FlightFitSettings out;
  out.gravity_mps2 = knowledge.gravity_mps2;
  out.drag_per_m = knowledge.drag_per_m;
  out.sigma_drag_per_m = drag_unknown ? knowledge.sigma_drag_per_m : 0.0;
  if (knowledge.gravity) {
    out.gravity_cam_mps2 = knowledge.gravity->gravity_cam_mps2;
    out.sigma_gravity_rad = knowledge.gravity->sigma_rad;
  }
  out.search_outliers = false;
  return out;
}

/// Fits the points and leaves out what does not belong. False where nothing sensible is left.
bool refit(const CandidateHistory& history, const FlightKnowledge& knowledge, bool drag_unknown,
           GrownFlight& flight) {
  const auto rays = rays_of(history, flight.points, knowledge);
  auto fit = fit_flight(0, history.epoch(), rays, settings_for(knowledge, drag_unknown));
  if (!fit) return false;
  std::vector<CandidateRef> kept;
  for (std::size_t i = 0; i < flight.points.size(); ++i)
    if (fit->used[i]) kept.push_back(flight.points[i]);
  if (kept.size() < min_points) return false;
  flight.points = std::move(kept);
  fit->used.assign(flight.points.size(), true);
  fit->camera = history.at(flight.points.front()).sighting.camera;
  flight.fit = *std::move(fit);
  return true;
}

/// Distance of a candidate from the flight, both uncertain: chi-square of 2 degrees of freedom.
double distance_chi2(const CandidateHistory& history, const FlightKnowledge& knowledge,
                     const CameraFlight& fit, const Candidate& candidate) {
  const double t = candidate.ray.time_s - seconds(fit.epoch - history.epoch());
  const Eigen::Vector3d position = fit.at(t).position_m;
  if (position.dot(candidate.ray.direction_cam) <= 0) return 1e300;
  const double range = position.norm();
  const Eigen::Vector3d unit = position / range;
  const Eigen::Matrix<double, 2, 3> W = candidate.ray.whitener / noise_factor(knowledge, candidate);
  const Eigen::Vector2d r = W * unit;
  // Far outside even a poor prediction: spare the covariance.
  if (r.squaredNorm() > 1e6) return 1e300;
  const Eigen::Matrix<double, 2, 3> J = (W - r * unit.transpose()) / range;
  const Eigen::Matrix3d cov = fit.covariance_at(t).topLeftCorner<3, 3>();
  const Eigen::Matrix2d S = Eigen::Matrix2d::Identity() + J * cov * J.transpose();
  return r.dot(S.inverse() * r);
}

std::optional<std::size_t> nearest(const CandidateHistory& history,
                                   const FlightKnowledge& knowledge, const CameraFlight& fit,
                                   std::int64_t frame) {
  std::optional<std::size_t> out;
  double least = gate_chi2;
  const auto& candidates = history.frame(frame).candidates;
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    if (candidates[i].taken) continue;
    const double d = distance_chi2(history, knowledge, fit, candidates[i]);
    if (d >= least) continue;
    least = d;
    out = i;
  }
  return out;
}

/// One round outwards from an end, as far as the prediction may be trusted before the next fit.
std::vector<CandidateRef> beyond(const CandidateHistory& history, const FlightKnowledge& knowledge,
                                 const GrownFlight& flight, int direction) {
  std::vector<CandidateRef> out;
  const std::int64_t edge =
      direction > 0 ? flight.points.back().frame : flight.points.front().frame;
  const double span_s = flight.fit.last_s - flight.fit.first_s;
  const double horizon_s = std::max(0.1, 0.3 * span_s);
  std::int64_t seen = edge;
  for (std::int64_t f = edge + direction; f >= history.begin_frame() && f < history.end_frame();
       f += direction) {
    const double gap_s = std::abs(history.frame(f).time_s - history.frame(seen).time_s);
    if (gap_s > max_pause_s || (std::abs(f - seen) > patience_frames && gap_s > patience_s)) break;
    if (std::abs(history.frame(f).time_s - history.frame(edge).time_s) > horizon_s) break;
    const auto i = nearest(history, knowledge, flight.fit, f);
    if (!i) continue;
    out.push_back({f, *i});
    seen = f;
  }
  return out;
}

std::vector<CandidateRef> between(const CandidateHistory& history, const FlightKnowledge& knowledge,
                                  const GrownFlight& flight) {
  std::vector<CandidateRef> out;
  std::size_t k = 0;
  for (std::int64_t f = flight.points.front().frame; f <= flight.points.back().frame; ++f) {
    if (flight.points[k].frame == f) {
      ++k;
      continue;
    }
    if (const auto i = nearest(history, knowledge, flight.fit, f)) out.push_back({f, *i});
  }
  return out;
}

void drop(std::vector<CandidateRef>& points, std::size_t count, bool front) {
  const auto n = static_cast<std::ptrdiff_t>(count);
  if (front)
    points.erase(points.begin(), points.begin() + n);
  else
    points.erase(points.end() - n, points.end());
}

/// By how many sigmas the `count` outermost points cost more than chance.
double excess(const CandidateHistory& history, const FlightKnowledge& knowledge,
              const GrownFlight& flight, std::size_t count, bool front) {
  GrownFlight shorter = flight;
  drop(shorter.points, count, front);
  const std::size_t before = shorter.points.size();
  if (!refit(history, knowledge, true, shorter) || shorter.points.size() != before) return 0.0;
  const double dof = 2.0 * static_cast<double>(count);
  return (flight.fit.chi2 - shorter.fit.chi2 - dof) / std::sqrt(2.0 * dof);
}

/// Drops the outermost points whose cost is more than chance allows.
void trim(const CandidateHistory& history, const FlightKnowledge& knowledge, GrownFlight& flight) {
  while (flight.points.size() > min_points + 2) {
    double worst = excess_sigmas;
    std::size_t count = 0;
    bool front = false;
    for (const std::size_t n : {1u, 2u, 3u, 4u, 6u, 8u, 12u}) {
      if (flight.points.size() < min_points + n || 2 * n > flight.points.size()) break;
      for (const bool at_front : {true, false}) {
        const double z = excess(history, knowledge, flight, n, at_front);
        if (z <= worst) continue;
        worst = z;
        count = n;
        front = at_front;
      }
    }
    if (count == 0) return;
    GrownFlight shorter = flight;
    drop(shorter.points, count, front);
    if (!refit(history, knowledge, true, shorter)) return;
    flight = std::move(shorter);
  }
}

bool has_the_balls_size(const CandidateHistory& history, const GrownFlight& flight) {
  std::vector<double> log_ratios;
  const double epoch_s = seconds(flight.fit.epoch - history.epoch());
  for (const CandidateRef& ref : flight.points) {
    const Candidate& c = history.at(ref);
    if (!c.range_m) continue;
    log_ratios.push_back(
        elementary::log(flight.fit.at(c.ray.time_s - epoch_s).position_m.norm() / *c.range_m));
  }
  if (log_ratios.empty()) return true;
  const auto middle = log_ratios.begin() + static_cast<std::ptrdiff_t>(log_ratios.size() / 2);
  std::nth_element(log_ratios.begin(), middle, log_ratios.end());
  return std::abs(*middle) < max_log_size_error;
}

}  // namespace

bool is_clear_beyond(const CandidateHistory& history, const GrownFlight& flight, bool front) {
  const std::int64_t step = front ? -1 : 1;
  const std::int64_t edge = front ? flight.points.front().frame : flight.points.back().frame;
  const double edge_s = history.frame(edge).time_s;
  for (std::int64_t n = edge + step; n >= history.begin_frame() && n < history.end_frame();
       n += step) {
    const CandidateFrame& frame = history.frame(n);
    if (std::abs(frame.time_s - edge_s) > beyond_intervals * history.frame_interval_s()) break;
    for (const Candidate& candidate : frame.candidates) {
      const double t = candidate.ray.time_s - seconds(flight.fit.epoch - history.epoch());
      const Eigen::Vector3d position = flight.fit.at(t).position_m;
      if (candidate.ray.direction_cam.cross(position).norm() < near_m) return false;
    }
  }
  return true;
}

bool is_plausible(const CandidateHistory& history, const GrownFlight& flight) {
  const CameraFlight& fit = flight.fit;
  if (fit.dof <= 0 || fit.chi2 > max_chi2_per_dof * fit.dof) return false;
  for (const double t : {fit.first_s, fit.last_s})
    if (fit.at(t).velocity_mps.norm() > max_speed_mps) return false;
  const double range = fit.position_cam_m.norm();
  const Eigen::Vector3d ray = fit.position_cam_m / range;
  const double var_depth = ray.dot(fit.covariance.topLeftCorner<3, 3>() * ray);
  if (var_depth > square(max_relative_sigma_depth * range)) return false;
  return has_the_balls_size(history, flight);
}

std::optional<GrownFlight> seed_flight(const CandidateHistory& history,
                                       std::span<const CandidateRef> points,
                                       const FlightKnowledge& knowledge) {
  GrownFlight out{{points.begin(), points.end()}, {}};
  if (points.size() < min_points || !refit(history, knowledge, false, out)) return std::nullopt;
  // One bad link in ten is repaired, more is not a flight.
  if (10 * out.points.size() < 9 * points.size() || !is_plausible(history, out))
    return std::nullopt;
  return out;
}

void grow_flight(const CandidateHistory& history, const FlightKnowledge& knowledge,
                 GrownFlight& flight) {
  for (int round = 0; round < max_growth_rounds; ++round) {
    GrownFlight larger = flight;
    for (const auto& more :
         {beyond(history, knowledge, flight, 1), beyond(history, knowledge, flight, -1),
          between(history, knowledge, flight)})
      larger.points.insert(larger.points.end(), more.begin(), more.end());
    if (larger.points.size() == flight.points.size()) return;
    std::sort(larger.points.begin(), larger.points.end());
    if (!refit(history, knowledge, true, larger)) return;
    if (larger.points.size() <= flight.points.size() ||
        larger.fit.chi2 > max_chi2_per_dof * larger.fit.dof)
      return;
    flight = std::move(larger);
  }
}

void settle_flight(const CandidateHistory& history, const FlightKnowledge& knowledge,
                   GrownFlight& flight) {
  for (int round = 0; round < 2; ++round) {
    grow_flight(history, knowledge, flight);
    trim(history, knowledge, flight);
  }
  GrownFlight best = flight;
  for (const bool at_front : {true, false}) {
    GrownFlight other = flight;
    drop(other.points, bent_points, at_front);
    if (other.points.size() < min_points || !refit(history, knowledge, true, other)) continue;
    const std::size_t before = other.points.size() + bent_points;
    grow_flight(history, knowledge, other);
    if (other.points.size() <= before) continue;
    trim(history, knowledge, other);
    if (other.points.size() > best.points.size()) best = std::move(other);
  }
  flight = std::move(best);
}

bool merge_flights(const CandidateHistory& history, const FlightKnowledge& knowledge,
                   GrownFlight& flight, const GrownFlight& other) {
  const GrownFlight& earlier = flight.points.front() < other.points.front() ? flight : other;
  const GrownFlight& later = &earlier == &flight ? other : flight;
  const double gap_s =
      history.at(later.points.front()).ray.time_s - history.at(earlier.points.back()).ray.time_s;
  if (gap_s > max_merge_gap_s) return false;
  GrownFlight whole;
  std::set_union(flight.points.begin(), flight.points.end(), other.points.begin(),
                 other.points.end(), std::back_inserter(whole.points));
  const std::size_t before = whole.points.size();
  if (!refit(history, knowledge, true, whole)) return false;
  if (10 * whole.points.size() < 9 * before || whole.points.size() < flight.points.size() ||
      whole.points.size() < other.points.size() || !is_plausible(history, whole))
    return false;
  flight = std::move(whole);
  return true;
}

}  // namespace throwcal
