// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/throw_iteration.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "estimator/linearisation.h"

namespace throwcal {
namespace {

constexpr int last_passes = 2;  // over each ball, with the rig held
constexpr double misfits_believed = 3.0, least_noise_rad = 0.005, still_better = 0.99;

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

/// Camera 1 is held in the x-z plane, and a rough start can carry it over the vertical in there:
/// the same rig, turned by half a turn. The world's x axis is where it looks.
void turn_to_face_x(Solution& at) {
  if (at.rig.T_world_cam[0].rotation(0, 2) >= 0) return;
  const Eigen::Matrix3d half_turn = Eigen::Vector3d(-1, -1, 1).asDiagonal();
  for (Rigid& pose : at.rig.T_world_cam)
    pose = {half_turn * pose.rotation, half_turn * pose.translation};
  for (BallState& ball : at.balls)
    ball = {half_turn * ball.position_m, half_turn * ball.velocity_mps};
}

/// Median distance of what was seen from what is predicted, as an angle [rad].
double median_misfit_rad(const RigDescription& rig, const std::vector<TimedThrow>& throws,
                         const Solution& at) {
  const auto residuals = claimed_residuals(rig, throws, at);
  std::vector<double> sizes;
  for (std::size_t j = 0; j < throws.size(); ++j)
    for (std::size_t i = 0; i < residuals[j].size(); ++i) {
      const TimedSighting& s = throws[j].sightings[i];
      const double size_px = (s.whitening.inverse() * residuals[j][i]).norm();
      if (at.rig.is_placed[s.camera] && std::isfinite(size_px))
        sizes.push_back(size_px / rig.cameras[s.camera].model.fx_px);
    }
  if (sizes.empty()) return 0.0;
  const auto middle = sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() / 2);
  std::nth_element(sizes.begin(), middle, sizes.end());
  return *middle;
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
  double last_misfit_rad = std::numeric_limits<double>::infinity();
  bool polishes = false;
  for (int sweep = 0; sweep < sweeps; ++sweep) {
    const RigState before = filter.rig();
    filter.reset_rig_covariance();
    for (std::size_t j = 0; j < throws.size(); ++j) {
      const BallState& from = method == Method::rb_ekf ? out.balls[j] : start.balls[j];
      out.balls[j] = pass_over(filter, throws[j], from, method == Method::rb_ekf);
    }
    if (settings.progress) settings.progress((sweep + 1.0) / sweeps);
    out.rig = filter.rig();
    const double misfit_rad = median_misfit_rad(rig, throws, out);
    polishes = polishes || misfit_rad > still_better * last_misfit_rad;
    last_misfit_rad = misfit_rad;
    filter.believe_noise(polishes ? settings.ekf.noise_rad
                                  : std::clamp(misfits_believed * misfit_rad, least_noise_rad,
                                               settings.ekf.noise_rad));
    if (largest_move(before, filter.rig()) < settings.enough) break;
  }
  if (sweeps > 0) {
    filter.hold_rig();
    for (std::size_t j = 0; j < throws.size(); ++j)
      for (int pass = 0; pass < last_passes; ++pass)
        out.balls[j] = pass_over(filter, throws[j], out.balls[j], true);
  }
  out.rig = filter.rig();
  turn_to_face_x(out);
  return out;
}

}  // namespace throwcal
