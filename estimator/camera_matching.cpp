// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/camera_matching.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace throwcal {
namespace {

using Pairs = std::vector<std::pair<std::size_t, std::size_t>>;

constexpr double speed_slack_mps = 0.15;  // beside what the fits' covariances allow
constexpr double min_overlap_s = 0.05;
constexpr double min_shared_fraction = 0.3;  // of the flights that could be shared

struct Horizontal {
  double speed_mps = 0.0, var_speed = 0.0, var_climb = 0.0;
};

Horizontal at_apex(const CameraFlight& flight) {
  const double t = apex_s(flight);
  const Eigen::Vector3d up = -flight.gravity_cam_mps2.normalized();
  const Eigen::Vector3d velocity = flight.at(t).velocity_mps;
  const Eigen::Vector3d level = velocity - up * up.dot(velocity);
  const Eigen::Matrix3d cov = flight.covariance_at(t).bottomRightCorner<3, 3>();
  const Eigen::Vector3d along =
      level.norm() > 1e-6 ? Eigen::Vector3d(level.normalized()) : Eigen::Vector3d::Zero();
  return {level.norm(), along.dot(cov * along), up.dot(cov * up)};
}

/// Whether two flights may be one, whatever the cameras' poses.
bool may_be_one(const CameraFlight& a, const CameraFlight& b, const AlignmentSettings& settings) {
  const double shift_s = seconds(b.epoch - a.epoch);
  const double limit_s = settings.estimate_offset ? settings.max_offset_s : 0.0;
  const double overlap_s =
      std::min(a.last_s, b.last_s + shift_s) - std::max(a.first_s, b.first_s + shift_s) + limit_s;
  if (overlap_s < min_overlap_s) return false;
  const Horizontal level_a = at_apex(a), level_b = at_apex(b);
  const double g = a.gravity_cam_mps2.norm();
  const double apart_s = std::abs(apex_s(b) + shift_s - apex_s(a));
  const double sigma_apex_s = std::sqrt(level_a.var_climb + level_b.var_climb) / g;
  if (apart_s > limit_s + 4 * sigma_apex_s + 0.005 + 3 * settings.slack_mps / g) return false;
  const double sigma_speed = std::sqrt(level_a.var_speed + level_b.var_speed);
  return std::abs(level_a.speed_mps - level_b.speed_mps) <
         4 * sigma_speed + speed_slack_mps + 3 * settings.slack_mps;
}

/// One-to-one, the best agreement first.
Pairs inliers(std::span<const CameraFlight> a, std::span<const CameraFlight> b,
              const Pairs& possible, const CameraAlignment& alignment, double gate, double* score) {
  std::vector<std::pair<double, std::size_t>> ranked;
  for (std::size_t k = 0; k < possible.size(); ++k) {
    const double chi2 = mismatch_chi2(alignment, a[possible[k].first], b[possible[k].second]);
    if (chi2 < gate) ranked.emplace_back(chi2, k);
  }
  std::sort(ranked.begin(), ranked.end());
  std::vector<bool> used_a(a.size(), false), used_b(b.size(), false);
  Pairs out;
  *score = 0.0;
  for (const auto& [chi2, k] : ranked) {
    const auto [i, j] = possible[k];
    if (used_a[i] || used_b[j]) continue;
    used_a[i] = used_b[j] = true;
    out.push_back(possible[k]);
    *score += 1.0 - 0.5 * chi2 / gate;
  }
  std::sort(out.begin(), out.end());
  return out;
}

std::optional<CameraAlignment> align(std::span<const CameraFlight> a,
                                     std::span<const CameraFlight> b, const Pairs& pairs,
                                     const AlignmentSettings& settings) {
  std::vector<FlightPair> shared;
  for (const auto& [i, j] : pairs) shared.emplace_back(a[i], b[j]);
  return align_cameras(shared, settings);
}

}  // namespace

std::optional<CameraMatch> match_cameras(std::span<const CameraFlight> a,
                                         std::span<const CameraFlight> b,
                                         const AlignmentSettings& settings) {
  Pairs possible;
  for (std::size_t i = 0; i < a.size(); ++i)
    for (std::size_t j = 0; j < b.size(); ++j)
      if (may_be_one(a[i], b[j], settings)) possible.emplace_back(i, j);
  std::vector<bool> could_be(a.size(), false);
  for (const auto& [i, j] : possible) could_be[i] = true;

  std::optional<CameraMatch> best;
  for (const auto& seed : possible) {
    // It would lead to the same hypothesis again.
    if (best && std::ranges::binary_search(best->pairs, seed)) continue;
    auto alignment = align(a, b, {seed}, settings);
    CameraMatch match;
    for (int round = 0; alignment && round < 3; ++round) {
      match.alignment = *alignment;
      Pairs pairs = inliers(a, b, possible, *alignment, settings.gate_chi2, &match.score);
      const bool is_settled = pairs == match.pairs;
      match.pairs = std::move(pairs);
      if (is_settled || match.pairs.empty()) break;
      alignment = align(a, b, match.pairs, settings);
    }
    if (!alignment || match.pairs.empty() || (best && match.score <= best->score)) continue;
    match.alignment = *alignment;
    best = std::move(match);
  }
  const auto count = static_cast<double>(std::count(could_be.begin(), could_be.end(), true));
  if (best && static_cast<double>(best->pairs.size()) < min_shared_fraction * count) best.reset();
  return best;
}

}  // namespace throwcal
