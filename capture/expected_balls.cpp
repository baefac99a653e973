// SPDX-License-Identifier: BSD-3-Clause
#include "capture/expected_balls.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace throwcal {
namespace {

constexpr double max_speed_mps = 15.0;
constexpr double max_radius_ratio = 1.35;  ///< from frame to frame
constexpr double gravity_mps2 = 9.81;
constexpr double max_jerk_px = 1.0, max_jerk_radii = 0.25;  ///< beside gravity's
constexpr double max_interval_ratio = 1.5;                  ///< else a frame is missing
constexpr double near_px = 2.0;                             ///< and a radius: found where expected
constexpr int max_hidden_frames = 4;
constexpr std::size_t most_expected = 8;

}  // namespace

ExpectedBalls::ExpectedBalls(double ball_diameter_m) : ball_diameter_m_(ball_diameter_m) {
  for (Seen& seen : seen_) seen.balls.reserve(64);
  expected_balls_.reserve(256);
  expected_.reserve(256);
}

void ExpectedBalls::add(HostTime time, std::span<const BallOutline> found) {
  std::rotate(seen_.begin(), seen_.end() - 1, seen_.end());
  Seen& now = seen_.front();
  now.time = time;
  now.balls.clear();
  for (const BallOutline& outline : found) now.balls.push_back({outline, 0});
  for (const Ball& ball : expected_balls_) {
    const auto is_it = [&](const Ball& other) {
      return (other.outline.centre_px - ball.outline.centre_px).norm() <
             ball.outline.radius_px + near_px;
    };
    if (ball.hidden_frames < max_hidden_frames && std::ranges::none_of(now.balls, is_it))
      now.balls.push_back({ball.outline, ball.hidden_frames + 1});
  }
  expected_balls_.clear();
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
  expected_balls_.clear();
  expected_.clear();
  const auto& [last, before, first] = seen_;
  if (frames_ < seen_.size()) return expected_;
  const double next_s = seconds(time - last.time), last_s = seconds(last.time - before.time),
               first_s = seconds(before.time - first.time);
  const auto [shortest_s, longest_s] = std::minmax({next_s, last_s, first_s});
  if (shortest_s <= 0 || longest_s > max_interval_ratio * shortest_s) return expected_;
  for (const auto& [c, hidden_frames] : last.balls)
    for (const auto& [b, b_hidden] : before.balls) {
      if (!is_step(b, c, last_s)) continue;
      for (const auto& [a, a_hidden] : first.balls) {
        if (!is_step(a, b, first_s)) continue;
        const Eigen::Vector2d bend = c.centre_px - 2 * b.centre_px + a.centre_px;
        const double fall_px = gravity_mps2 * last_s * last_s * 2 * c.radius_px / ball_diameter_m_;
        if (bend.norm() > fall_px + max_jerk_px + max_jerk_radii * c.radius_px) continue;
        const Eigen::Vector2d step = c.centre_px - b.centre_px;
        // A streak is the movement in a part of the interval; it bends along with it.
        const double share =
            c.streak_px.norm() / std::max((step + 0.5 * bend).norm(), c.streak_px.norm() + 1e-9);
        expected_balls_.push_back(
            {{c.centre_px + step + bend, c.radius_px, share * (step + 1.5 * bend)}, hidden_frames});
      }
    }
  if (expected_balls_.size() > most_expected) {  // the largest of those seen last
    std::ranges::sort(expected_balls_, {}, [](const Ball& ball) {
      return std::pair(ball.hidden_frames, -ball.outline.radius_px);
    });
    expected_balls_.resize(most_expected);
  }
  for (const Ball& ball : expected_balls_) expected_.push_back(ball.outline);
  return expected_;
}

}  // namespace throwcal
