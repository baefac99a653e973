// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/report.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>

#include "estimator/next_throw.h"
#include "estimator/verdict.h"

namespace throwcal {
namespace {

double rms_of(double squares, int count) { return count ? std::sqrt(squares / count) : 0.0; }

/// Pixel residual of one in units of the claimed noise.
Eigen::Vector2d in_pixels(const TimedSighting& s, const Eigen::Vector2d& residual) {
  return s.whitening.inverse() * residual;
}

ThrowEstimate throw_estimate(const RigDescription& rig, const TimedThrow& thrown,
                             const Refinement& at, std::size_t j) {
  ThrowEstimate out{thrown.id, thrown.epoch, thrown.epoch, {}, {}, {}, 0.0};
  double first_s = 0.0, last_s = 0.0, squares = 0.0;
  int count = 0;
  for (std::size_t i = 0; i < thrown.sightings.size(); ++i) {
    if (!at.weighting.used[j][i]) continue;
    const TimedSighting& s = thrown.sightings[i];
    const double seen_s = moment_s(at.solution.rig, s);
    first_s = count ? std::min(first_s, seen_s) : seen_s;
    last_s = count ? std::max(last_s, seen_s) : seen_s;
    squares += in_pixels(s, at.residuals[j][i]).squaredNorm(), count += 2;
    if (std::find(out.cameras.begin(), out.cameras.end(), s.camera) == out.cameras.end())
      out.cameras.push_back(s.camera);
  }
  std::sort(out.cameras.begin(), out.cameras.end());
  const BallState ball =
      fly(at.solution.balls[j], first_s, {0, 0, -rig.gravity_mps2}, at.solution.rig.drag_per_m);
  out.start = thrown.epoch + from_seconds(first_s), out.end = thrown.epoch + from_seconds(last_s);
  out.position_world_m = ball.position_m, out.velocity_world_mps = ball.velocity_mps;
  out.reprojection_rms_px = rms_of(squares, count);
  return out;
}

double sigma_of(const Refinement& at, int index) {
  return std::sqrt(std::max(0.0, at.covariance(index, index)));
}

CameraCalibration camera_calibration(const RigDescription& rig, const Refinement& at,
                                     std::size_t k) {
  CameraCalibration out;
  out.name = rig.cameras[k].name;
  const RigState& state = at.solution.rig;
  if (!state.is_placed[k]) return out;
  const RigLayout::Camera& camera = at.layout.camera(k);
  out.T_world_cam = state.T_world_cam[k];
  out.covariance = at.layout.pose_covariance(k, state, at.covariance);
  out.time_offset_s = state.time_offset_s[k];
  if (camera.offset) out.sigma_time_offset_s = sigma_of(at, camera.start + *camera.offset);
  for (std::size_t i = 0; i < camera.intrinsics.size(); ++i)
    out.lens.push_back({name_of(camera.intrinsics[i], state.models[k].lens),
                        state.models[k].at(camera.intrinsics[i]),
                        sigma_of(at, camera.start + camera.lens + static_cast<int>(i))});
  return out;
}

Calibration empty_report(const RigDescription& rig, const std::vector<Throw>& given,
                         Method method) {
  Calibration out;
  out.method = method;
  out.gravity_mps2 = rig.gravity_mps2, out.gravity_source = rig.gravity_source;
  out.drag_per_m = rig.ball.drag_per_m;
  for (const CameraDescription& camera : rig.cameras)
    out.cameras.push_back(
        {.name = camera.name, .T_world_cam = {}, .covariance = {}, .sigma_time_offset_s = {}});
  for (const Throw& thrown : given)
    for (const Track& track : thrown.tracks)
      for (const BallSighting& s : track.sightings) {
        out.residuals.push_back({s.id, thrown.id, false, Eigen::Vector2d::Constant(std::nan(""))});
        ++out.cameras[s.camera].sightings_rejected;
      }
  return out;
}

}  // namespace

Calibration report(const RigDescription& rig, const std::vector<Throw>& given,
                   const std::vector<TimedThrow>& used, const Refinement& refinement,
                   Method method) {
  Calibration out = empty_report(rig, given, method);
  for (std::size_t k = 0; k < rig.cameras.size(); ++k) {
    const int all = out.cameras[k].sightings_rejected;
    out.cameras[k] = camera_calibration(rig, refinement, k);
    out.cameras[k].sightings_rejected = all;
  }
  std::map<std::uint64_t, std::pair<bool, Eigen::Vector2d>> fates;
  std::vector<double> squares(rig.cameras.size(), 0.0);
  for (std::size_t j = 0; j < used.size(); ++j)
    for (std::size_t i = 0; i < used[j].sightings.size(); ++i) {
      const TimedSighting& s = used[j].sightings[i];
      const Eigen::Vector2d residual = in_pixels(s, refinement.residuals[j][i]);
      fates[s.id] = {refinement.weighting.used[j][i], residual};
      if (!refinement.weighting.used[j][i]) continue;
      squares[s.camera] += residual.squaredNorm();
      ++out.cameras[s.camera].sightings_used, --out.cameras[s.camera].sightings_rejected;
    }
  for (SightingResidual& r : out.residuals)
    if (const auto fate = fates.find(r.sighting_id); fate != fates.end())
      std::tie(r.used, r.residual_px) = fate->second;
  for (std::size_t k = 0; k < rig.cameras.size(); ++k)
    out.cameras[k].reprojection_rms_px = rms_of(squares[k], 2 * out.cameras[k].sightings_used);

  out.drag_per_m = refinement.solution.rig.drag_per_m;
  if (const auto drag = refinement.layout.drag())
    out.sigma_drag_per_m = sigma_of(refinement, *drag);
  for (std::size_t j = 0; j < used.size(); ++j)
    if (std::any_of(refinement.weighting.used[j].begin(), refinement.weighting.used[j].end(),
                    [](char u) { return u; }))
      out.throws.push_back(throw_estimate(rig, used[j], refinement, j));
  Judgement judgement = judge(rig, used, refinement);
  out.verdict = judgement.verdict, out.reasons = std::move(judgement.reasons);
  if (out.verdict != Verdict::rejected) out.next_throw = best_next_throw(rig, used, refinement);
  return out;
}

Calibration report_nothing_to_go_by(const RigDescription& rig, const std::vector<Throw>& given,
                                    Method method) {
  Calibration out = empty_report(rig, given, method);
  out.verdict = Verdict::unobservable;
  out.reasons = {given.empty()
                     ? "no throw was found: throw the ball so that at least two cameras see it fly"
                     : "no throw fixes a flight in camera " + rig.cameras.front().name +
                           ": throw higher and longer, so that it sees the ball for half a second"};
  return out;
}

}  // namespace throwcal
