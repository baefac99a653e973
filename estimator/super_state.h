// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <Eigen/Core>
#include <optional>
#include <vector>

#include "estimator/ballistics.h"
#include "estimator/rig_description.h"
#include "estimator/rigid.h"

namespace throwcal {

/// Everything that all throws share.
struct RigState {
  std::vector<Rigid> T_world_cam;
  std::vector<double> time_offset_s;  ///< t_true = time + offset; camera 1's is 0
  std::vector<CameraModel> models;    ///< the rig file's, with what is estimated of them
  double drag_per_m = 0.0;
  /// Whether a camera's pose is known at all; one that shares no flight with the others takes no
  /// part.
  std::vector<bool> is_placed;

  std::size_t cameras() const { return T_world_cam.size(); }
};

/// What the rig file says, before anything is known of the poses: no camera is placed.
RigState unplaced(const RigDescription& rig);

/// A rig and the balls thrown at it: each at its throw's epoch on camera 1's clock, world axes.
struct Solution {
  RigState rig;
  std::vector<BallState> balls;
};

/// The prediction of one sighting, linearised at a ball that is where it was at that moment [px].
struct SightingModel {
  Eigen::Vector2d residual_px;             ///< measured minus predicted
  Eigen::Matrix<double, 2, 3> J_position;  ///< d predicted / d ball position, world axes [px/m]
  /// d predicted / d rotation vector in world axes, R_true = exp([r]x) R [px/rad]
  Eigen::Matrix<double, 2, 3> J_rotation;
  Eigen::Vector2d J_offset;                     ///< d predicted / d time offset [px/s]
  Eigen::Matrix<double, 2, intrinsics> J_lens;  ///< in Intrinsic's order; only where asked for
};

/// The two turns that camera 1 may make: about world y, about its viewing direction (3x2, world
/// axes). Camera 1 keeps its position and heading: gravity fixes scale and the vertical, but no
/// throw can say where the origin is or which way is north; estimating those four numbers too only
/// makes the covariance singular.
Eigen::Matrix<double, 3, 2> camera_one_turns(const Rigid& T_world_cam1);

/// Named slices of the two parameter vectors. The rig's holds only what is free:
///   camera 1: [tilts 2 | lens], any other that is placed: [translation 3 | rotation 3 | offset 1
///   where asked for | lens], then [drag 1 where asked for].
/// Translations are T_world_cam's [m], rotations world-axes rotation vectors [rad], R_true =
/// exp([r]x) R; offsets [s]; lens numbers in their own units; drag [1/m]. The filter's super-state
/// (thesis eq. 4.10) puts the ball's six before it.
class RigLayout {
 public:
  static constexpr int ball_position = 0, ball_velocity = 3, ball_size = 6;
  static constexpr int max_camera_size = 7 + intrinsics;
  using CameraJacobian = Eigen::Matrix<double, 2, Eigen::Dynamic, 0, 2, max_camera_size>;

  RigLayout(const RigDescription& rig, const RigState& state);

  int size() const { return size_; }
  std::optional<int> drag() const { return drag_; }
  struct Camera {
    int start = 0, size = 0;    ///< of its slice; size 0: it is not placed
    int rotation = 0;           ///< where its rotation (camera 1: its tilts) stands in the slice
    int lens = 0;               ///< where its lens numbers stand in the slice
    std::optional<int> offset;  ///< where its offset stands in the slice
    std::vector<Intrinsic> intrinsics;  ///< which lens numbers, in order
  };
  const Camera& camera(std::size_t k) const { return cameras_[k]; }

  /// d predicted / d the camera's slice (2 x its size). `turns` are camera_one_turns().
  void fill_jacobian(std::size_t k, const SightingModel& model,
                     const Eigen::Matrix<double, 3, 2>& turns, CameraJacobian& out) const;

  /// Moves a state by a step of the rig's vector. Camera 1's two turns keep its viewing direction
  /// in the x-z plane exactly.
  void apply(const Eigen::Ref<const Eigen::VectorXd>& step, RigState& state) const;

  /// 6x6 covariance of a camera's (x y z rx ry rz) out of the rig's vector's; see
  /// CameraCalibration.
  Eigen::Matrix<double, 6, 6> pose_covariance(std::size_t k, const RigState& state,
                                              const Eigen::MatrixXd& covariance) const;

 private:
  std::vector<Camera> cameras_;
  std::optional<int> drag_;
  int size_ = 0;
};

}  // namespace throwcal
