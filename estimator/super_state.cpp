// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/super_state.h"

#include <Eigen/Dense>

namespace throwcal {

Eigen::Matrix<double, 3, 2> camera_one_turns(const Rigid& T_world_cam1) {
  Eigen::Matrix<double, 3, 2> turns;
  turns << Eigen::Vector3d::UnitY(), T_world_cam1.rotation.col(2);
  return turns;
}

void RigState::apply(const Eigen::Ref<const Eigen::VectorXd>& step) {
  for (std::size_t k = 0; k < cameras(); ++k) {
    Rigid& pose = T_world_cam[k];
    const Eigen::Vector3d turn = step.segment<3>(slice::camera(k) + slice::rotation);
    if (k == 0) {
      const Eigen::Matrix<double, 3, 2> turns = camera_one_turns(pose);
      const Eigen::Vector2d amount =
          (turns.transpose() * turns).inverse() * turns.transpose() * turn;
      pose.rotation = exp_so3({0, amount[0], 0}) * pose.rotation * exp_so3({0, 0, amount[1]});
      continue;
    }
    pose.translation += step.segment<3>(slice::camera(k) + slice::translation);
    pose.rotation = exp_so3(turn) * pose.rotation;
    time_offset_s[k] += step[slice::camera(k) + slice::offset];
  }
  drag_per_m += step[slice::drag(cameras())];
}

Eigen::MatrixXd gauge_directions(const RigDescription& rig, const RigState& state) {
  const std::size_t cameras = state.cameras();
  Eigen::MatrixXd free = Eigen::MatrixXd::Zero(slice::rig_size(cameras), slice::rig_size(cameras));
  free.block<3, 2>(slice::rotation, 0) = camera_one_turns(state.T_world_cam[0]);
  int column = 2;
  for (std::size_t k = 1; k < cameras; ++k)
    if (state.is_placed[k])
      for (int i = 0; i < (rig.estimate_offsets ? slice::camera_size : slice::offset); ++i)
        free(slice::camera(k) + i, column++) = 1.0;
  if (rig.ball.estimate_drag) free(slice::drag(cameras), column++) = 1.0;
  return free.leftCols(column);
}

}  // namespace throwcal
