// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/throw_set.h"

#include <Eigen/Dense>
#include <algorithm>

namespace throwcal {
namespace {

Eigen::Matrix2d whitening_of(const CameraDescription& camera, const BallSighting& sighting) {
  if (camera.sigma_px) return Eigen::Matrix2d::Identity() / *camera.sigma_px;
  const Eigen::LLT<Eigen::Matrix2d> llt(sighting.cov_px2);
  return llt.matrixL().solve(Eigen::Matrix2d::Identity());
}

}  // namespace

std::vector<TimedThrow> time_throws(const RigDescription& rig, const std::vector<Throw>& throws) {
  std::vector<TimedThrow> out;
  for (const Throw& thrown : throws) {
    TimedThrow timed{thrown.id, {}, {}};
    auto first = HostTime::max(), last = HostTime::min();
    for (const Track& track : thrown.tracks)
      for (const BallSighting& s : track.sightings)
        first = std::min(first, s.time), last = std::max(last, s.time);
    if (first > last) continue;  // an empty throw says nothing
    timed.epoch = first + (last - first) / 2;
    for (const Track& track : thrown.tracks)
      for (const BallSighting& s : track.sightings)
        timed.sightings.push_back({track.camera, seconds(s.time - timed.epoch), s.center_px,
                                   whitening_of(rig.cameras[track.camera], s), s.id});
    const auto row_s = [&](const TimedSighting& s) {
      return s.row0_s + rig.cameras[s.camera].model.row_time_s * s.pixel.y();
    };
    std::stable_sort(timed.sightings.begin(), timed.sightings.end(),
                     [&](const auto& a, const auto& b) { return row_s(a) < row_s(b); });
    out.push_back(std::move(timed));
  }
  return out;
}

std::optional<Eigen::Vector2d> residual_px(const RigState& rig, const BallState& ball,
                                           const TimedSighting& sighting) {
  const CameraModel& model = rig.models[sighting.camera];
  if (model.row_time_s != 0.0) {
    SightingModel linear;
    if (!model_sighting(rig, ball, sighting, false, false, linear)) return std::nullopt;
    return linear.residual_px;
  }
  const Rigid& T_world_cam = rig.T_world_cam[sighting.camera];
  const auto predicted =
      model.project(T_world_cam.rotation.transpose() * (ball.position_m - T_world_cam.translation));
  if (!predicted) return std::nullopt;
  return sighting.pixel - *predicted;
}

bool model_sighting(const RigState& rig, const BallState& ball, const TimedSighting& sighting,
                    bool wants_lens, bool in_sigmas, SightingModel& out) {
  const CameraModel& model = rig.models[sighting.camera];
  const Rigid& T_world_cam = rig.T_world_cam[sighting.camera];
  const Eigen::Vector3d arm = ball.position_m - T_world_cam.translation;
  Eigen::Matrix<double, 2, 3> J_point;
  Eigen::Matrix<double, 2, lens_intrinsics> J_intrinsics;
  const auto predicted = model.project(T_world_cam.rotation.transpose() * arm, &J_point,
                                       wants_lens ? &J_intrinsics : nullptr);
  if (!predicted) return false;
  out.residual_px = sighting.pixel - *predicted;
  if (model.row_time_s != 0.0 || in_sigmas) {
    Eigen::Matrix2d factor = in_sigmas ? sighting.whitening : Eigen::Matrix2d::Identity();
    if (model.row_time_s != 0.0) {
      Eigen::Matrix2d coupling = Eigen::Matrix2d::Identity();
      coupling.col(1) -=
          model.row_time_s * (J_point * (T_world_cam.rotation.transpose() * ball.velocity_mps));
      factor = factor * coupling.inverse();
    }
    out.residual_px = factor * out.residual_px;
    J_point = factor * J_point;
    if (wants_lens) J_intrinsics = factor * J_intrinsics;
  }
  out.J_position.noalias() = J_point.lazyProduct(T_world_cam.rotation.transpose());
  out.J_rotation.row(0) = out.J_position.row(0).cross(arm.transpose());  // J_position * skew(arm)
  out.J_rotation.row(1) = out.J_position.row(1).cross(arm.transpose());
  out.J_offset.noalias() = out.J_position.lazyProduct(ball.velocity_mps);
  if (wants_lens) out.J_lens << J_intrinsics, sighting.pixel.y() * out.J_offset;
  return true;
}

}  // namespace throwcal
