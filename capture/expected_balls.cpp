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

ExpectedBalls::ExpectedBalls(double ball_diameter_m, std::size_t max_found)
    : ball_diameter_m_(ball_diameter_m) {
  for (Seen& seen : seen_) seen.balls.reserve(max_found + most_expected);
  expected_.reserve(max_found + most_expected);
}

void ExpectedBalls::add(HostTime time, std::span<const KnownBall> found) {
  std::rotate(seen_.begin(), seen_.end() - 1, seen_.end());
  Seen& now = seen_.front();
  now.time = time;
  now.balls.assign(found.begin(), found.end());
  for (const KnownBall& ball : expected_) {
    const auto is_it = [&](const KnownBall& other) {
      return (other.outline.centre_px - ball.outline.centre_px).norm() <
             ball.outline.radius_px + near_px;
    };
    if (ball.hidden_frames < max_hidden_frames && std::ranges::none_of(now.balls, is_it))
      now.balls.push_back(
          {ball.outline, ball.hidden_frames + 1, ball.shrunk_frames, ball.was_whole});
  }
  expected_.clear();
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

/// Of the ways on which a ball may have come to where it is now; nothing where there is none.
std::optional<ExpectedBalls::Way> ExpectedBalls::straightest_way(const BallOutline& last) const {
  const auto& [now, before, first] = seen_;
  const double last_s = seconds(now.time - before.time);
  const double first_s = seconds(before.time - first.time);
  const double fall_px = gravity_mps2 * last_s * last_s * 2 * last.radius_px / ball_diameter_m_;
  double least_px = fall_px + max_jerk_px + max_jerk_radii * last.radius_px;
  std::optional<Way> straightest;
  for (const KnownBall& known : before.balls) {
    const BallOutline& b = known.outline;
    if (!is_step(b, last, last_s)) continue;
    for (const KnownBall& first_known : first.balls) {
      const BallOutline& a = first_known.outline;
      const Way way{last.centre_px - b.centre_px, last.centre_px - 2 * b.centre_px + a.centre_px};
      if (way.bend.norm() > least_px || !is_step(a, b, first_s)) continue;
      least_px = way.bend.norm();
      straightest = way;
    }
  }
  return straightest;
}

const std::vector<KnownBall>& ExpectedBalls::at(HostTime time) {
  expected_.clear();
  const auto& [last, before, first] = seen_;
  if (frames_ < seen_.size()) return expected_;
  const double next_s = seconds(time - last.time), last_s = seconds(last.time - before.time),
               first_s = seconds(before.time - first.time);
  const auto [shortest_s, longest_s] = std::minmax({next_s, last_s, first_s});
  if (shortest_s <= 0 || longest_s > max_interval_ratio * shortest_s) return expected_;
  for (const KnownBall& known : last.balls) {
    const BallOutline& ball = known.outline;
    const auto way = straightest_way(ball);
    if (!way) continue;
    const auto& [step, bend] = *way;
    // A streak is the movement in a part of the interval; it bends along with it.
    const double streak_px = ball.streak_px.norm();
    const double share = streak_px / std::max((step + 0.5 * bend).norm(), streak_px + 1e-9);
    expected_.push_back(
        {{ball.centre_px + step + bend, ball.radius_px, share * (step + 1.5 * bend)},
         known.hidden_frames,
         known.shrunk_frames,
         known.was_whole});
  }
  if (expected_.size() > most_expected) {  // the largest of those seen last
    std::ranges::sort(expected_, {}, [](const KnownBall& ball) {
      return std::pair(ball.hidden_frames, -ball.outline.radius_px);
    });
    expected_.resize(most_expected);
  }
  return expected_;
}

}  // namespace throwcal
