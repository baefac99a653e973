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
    for (const Track& track : thrown.tracks) {
      const CameraDescription& camera = rig.cameras[track.camera];
      for (const BallSighting& s : track.sightings)
        timed.sightings.push_back(
            {track.camera,
             seconds(s.time - timed.epoch) + camera.model.row_time_s * s.center_px.y(), s.center_px,
             whitening_of(camera, s), s.id});
    }
    std::stable_sort(timed.sightings.begin(), timed.sightings.end(),
                     [](const auto& a, const auto& b) { return a.time_s < b.time_s; });
    out.push_back(std::move(timed));
  }
  return out;
}

std::optional<SightingModel> model_sighting(const CameraModel& model, const Rigid& T_world_cam,
                                            const BallState& ball, const TimedSighting& sighting) {
  const Eigen::Vector3d arm = ball.position_m - T_world_cam.translation;
  Eigen::Matrix<double, 2, 3> J_point;
  const auto predicted = model.project(T_world_cam.rotation.transpose() * arm, &J_point);
  if (!predicted) return std::nullopt;

  SightingModel out;
  out.J_position = J_point * T_world_cam.rotation.transpose();
  const Eigen::Vector2d speed_px_s = out.J_position * ball.velocity_mps;
  out.J_camera << -out.J_position, out.J_position * skew(arm), speed_px_s;
  out.residual_px = sighting.pixel - *predicted;
  if (model.row_time_s != 0.0) {
    Eigen::Matrix2d coupling = Eigen::Matrix2d::Identity();
    coupling.col(1) -= model.row_time_s * speed_px_s;
    const Eigen::Matrix2d decoupled = coupling.inverse();
    out.residual_px = decoupled * out.residual_px;
    out.J_position = decoupled * out.J_position;
    out.J_camera = decoupled * out.J_camera;
  }
  return out;
}

}  // namespace throwcal
