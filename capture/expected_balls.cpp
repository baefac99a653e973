// SPDX-License-Identifier: BSD-3-Clause
#include "capture/expected_balls.h"

#include <algorithm>
#include <cmath>

namespace throwcal {
namespace {

constexpr double max_speed_mps = 15.0;
constexpr double max_radius_ratio = 1.35;  ///< from frame to frame
constexpr double gravity_mps2 = 9.81;
constexpr double max_jerk_px = 1.0, max_jerk_radii = 0.25;  ///< beside gravity's
constexpr double max_interval_ratio = 1.5;                  ///< else a frame is missing

}  // namespace

void ExpectedBalls::add(HostTime time, std::span<const BallOutline> found) {
  std::ranges::rotate(seen_, seen_.end() - 1);
  seen_.front().time = time;
  seen_.front().balls.assign(found.begin(), found.end());
  ++frames_;
}

/// Whether a ball may have gone from one outline to another: not faster than a throw at the
/// distance that its size tells.
bool ExpectedBalls::is_step(const BallOutline& from, const BallOutline& to,
                            double interval_s) const {
  const double ratio = to.radius_px / from.radius_px;
  const double reach_px =
      max_speed_mps * interval_s * 2 * from.radius_px / ball_diameter_m_ + max_jerk_px;
  return ratio < max_radius_ratio && ratio > 1 / max_radius_ratio &&
         (to.centre_px - from.centre_px).norm() < reach_px;
}

const std::vector<BallOutline>& ExpectedBalls::at(HostTime time) {
  expected_.clear();
  const auto& [last, before, first] = seen_;
  if (frames_ < seen_.size()) return expected_;
  const double next_s = seconds(time - last.time), last_s = seconds(last.time - before.time),
               first_s = seconds(before.time - first.time);
  const auto [shortest_s, longest_s] = std::minmax({next_s, last_s, first_s});
  if (shortest_s <= 0 || longest_s > max_interval_ratio * shortest_s) return expected_;
  for (const BallOutline& c : last.balls)
    for (const BallOutline& b : before.balls) {
      if (!is_step(b, c, last_s)) continue;
      for (const BallOutline& a : first.balls) {
        if (!is_step(a, b, first_s)) continue;
        const Eigen::Vector2d bend = c.centre_px - 2 * b.centre_px + a.centre_px;
        const double fall_px = gravity_mps2 * last_s * last_s * 2 * c.radius_px / ball_diameter_m_;
        if (bend.norm() > fall_px + max_jerk_px + max_jerk_radii * c.radius_px) continue;
        const Eigen::Vector2d step = c.centre_px - b.centre_px;
        // A streak is the movement in a part of the interval; it bends along with it.
        const double share =
            c.streak_px.norm() / std::max((step + 0.5 * bend).norm(), c.streak_px.norm() + 1e-9);
        expected_.push_back({c.centre_px + step + bend, c.radius_px, share * (step + 1.5 * bend)});
      }
    }
  return expected_;
}

}  // namespace throwcal
