// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/super_state.h"

#include <Eigen/Dense>

namespace throwcal {

RigState unplaced(const RigDescription& rig) {
  const std::size_t cameras = rig.cameras.size();
  RigState out{std::vector<Rigid>(cameras),
               std::vector<double>(cameras, 0.0),
               {},
               rig.ball.drag_per_m,
               std::vector<bool>(cameras, false)};
  for (const CameraDescription& camera : rig.cameras) out.models.push_back(camera.model);
  return out;
}

Eigen::Matrix<double, 3, 2> camera_one_turns(const Rigid& T_world_cam1) {
  Eigen::Matrix<double, 3, 2> turns;
  turns << Eigen::Vector3d::UnitY(), T_world_cam1.rotation.col(2);
  return turns;
}

RigLayout::RigLayout(const RigDescription& rig, const RigState& state) {
  for (std::size_t k = 0; k < state.cameras(); ++k) {
    Camera camera{.start = size_, .offset = {}, .intrinsics = {}};
    if (state.is_placed[k]) {
      camera.rotation = k == 0 ? 0 : 3;
      camera.size = k == 0 ? 2 : 6;
      if (k > 0 && rig.estimate_offsets) camera.offset = camera.size++;
      camera.lens = camera.size;
      camera.intrinsics = rig.cameras[k].estimate;
      camera.size += static_cast<int>(camera.intrinsics.size());
    }
    size_ += camera.size;
    cameras_.push_back(std::move(camera));
  }
  if (rig.ball.estimate_drag) drag_ = size_++;
}

void RigLayout::fill_jacobian(std::size_t k, const SightingModel& model,
                              const Eigen::Matrix<double, 3, 2>& turns, CameraJacobian& out) const {
  const Camera& camera = cameras_[k];
  out.resize(2, camera.size);
  if (k == 0) {
    out.leftCols<2>() = model.J_rotation.lazyProduct(turns);
  } else {
    out.leftCols<3>() = -model.J_position;  // only where the ball is from the camera matters
    out.middleCols<3>(3) = model.J_rotation;
  }
  if (camera.offset) out.col(*camera.offset) = model.J_offset;
  for (std::size_t i = 0; i < camera.intrinsics.size(); ++i)
    out.col(camera.lens + static_cast<int>(i)) =
        model.J_lens.col(static_cast<int>(camera.intrinsics[i]));
}

void RigLayout::apply(const Eigen::Ref<const Eigen::VectorXd>& step, RigState& state) const {
  for (std::size_t k = 0; k < cameras_.size(); ++k) {
    const Camera& camera = cameras_[k];
    if (camera.size == 0) continue;
    Rigid& pose = state.T_world_cam[k];
    const auto own = step.segment(camera.start, camera.size);
    if (k == 0) {
      pose.rotation = exp_so3({0, own[0], 0}) * pose.rotation * exp_so3({0, 0, own[1]});
    } else {
      pose.translation += own.head<3>();
      pose.rotation = exp_so3(own.segment<3>(3)) * pose.rotation;
    }
    if (camera.offset) state.time_offset_s[k] += own[*camera.offset];
    for (std::size_t i = 0; i < camera.intrinsics.size(); ++i)
      state.models[k].at(camera.intrinsics[i]) += own[camera.lens + static_cast<int>(i)];
  }
  if (drag_) state.drag_per_m += step[*drag_];
}

Eigen::Matrix<double, 6, 6> RigLayout::pose_covariance(std::size_t k, const RigState& state,
                                                       const Eigen::MatrixXd& covariance) const {
  Eigen::Matrix<double, 6, 6> out = Eigen::Matrix<double, 6, 6>::Zero();
  const int start = cameras_[k].start;
  if (k > 0) return covariance.block<6, 6>(start, start);
  const Eigen::Matrix<double, 3, 2> turns = camera_one_turns(state.T_world_cam[0]);
  out.bottomRightCorner<3, 3>() = turns * covariance.block<2, 2>(start, start) * turns.transpose();
  return out;
}

}  // namespace throwcal
