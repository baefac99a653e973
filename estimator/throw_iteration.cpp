// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/throw_iteration.h"

#include <algorithm>
#include <cmath>

namespace throwcal {
namespace {

/// Forward over a throw, and for the RB-EKF backward again; returns the ball at the epoch as the
/// pass leaves it.
BallState pass_over(Ekf& filter, const TimedThrow& thrown, const BallState& start, bool backward) {
  const RigState& rig = filter.rig();
  const auto takes_part = [&](const TimedSighting& s) { return rig.is_placed[s.camera]; };
  filter.start_throw(start);
  for (const TimedSighting& s : thrown.sightings)
    if (takes_part(s)) filter.update(s);
  if (backward)
    for (auto s = thrown.sightings.rbegin(); s != thrown.sightings.rend(); ++s)
      if (takes_part(*s)) filter.update(*s);
  filter.predict(0.0);
  return filter.ball();
}

double largest_move(const RigState& a, const RigState& b) {
  double moved = std::abs(a.drag_per_m - b.drag_per_m);
  for (std::size_t k = 0; k < a.cameras(); ++k) {
    moved = std::max(moved, (a.T_world_cam[k].translation - b.T_world_cam[k].translation).norm());
    moved = std::max(moved, (a.T_world_cam[k].rotation - b.T_world_cam[k].rotation).norm());
    moved = std::max(moved, std::abs(a.time_offset_s[k] - b.time_offset_s[k]));
  }
  return moved;
}

}  // namespace

Solution iterate_throws(const RigDescription& rig, const std::vector<TimedThrow>& throws,
                        const Solution& start, Method method,
                        const ThrowIterationSettings& settings) {
  Solution out = start;
  Ekf filter(rig, start.rig, settings.ekf);
  const int sweeps = method == Method::ekf ? 1 : settings.sweeps;
  for (int sweep = 0; sweep < sweeps; ++sweep) {
    const RigState before = filter.rig();
    filter.reset_rig_covariance();
    for (std::size_t j = 0; j < throws.size(); ++j) {
      const BallState ball = pass_over(filter, throws[j], out.balls[j], method == Method::rb_ekf);
      if (method == Method::rb_ekf || sweep + 1 == sweeps) out.balls[j] = ball;
    }
    if (settings.progress) settings.progress((sweep + 1.0) / sweeps);
    if (largest_move(before, filter.rig()) < settings.enough) break;
  }
  out.rig = filter.rig();
  return out;
}

}  // namespace throwcal
