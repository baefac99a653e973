// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <Eigen/Core>
#include <vector>

#include "estimator/ballistics.h"
#include "estimator/rig_description.h"
#include "estimator/rigid.h"

namespace throwcal {

/// Named slices of the parameter vectors. The rig's vector is [camera 1 | camera 2 | ... | drag],
/// seven numbers a camera; the filter's super-state (thesis eq. 4.10) puts the ball before it. All
/// cameras have all seven: what is not free (camera 1's position, heading and clock; offsets and
/// drag that are not asked for) is held by gauge_directions().
namespace slice {
constexpr int translation = 0;  ///< in a camera's block: T_world_cam's translation, world axes [m]
constexpr int rotation = 3;     ///< world-axes rotation vector [rad], R_true = exp([r]x) R
constexpr int offset = 6;       ///< t_true = time + offset [s]
constexpr int camera_size = 7;
constexpr int ball_position = 0, ball_velocity = 3,
              ball_size = 6;  ///< of the ball's block [m], [m/s], world axes

constexpr int camera(std::size_t k) { return camera_size * static_cast<int>(k); }
constexpr int drag(std::size_t cameras) { return camera(cameras); }  ///< [1/m]
constexpr int rig_size(std::size_t cameras) { return camera(cameras) + 1; }
}  // namespace slice

/// Everything that all throws share.
struct RigState {
  std::vector<Rigid> T_world_cam;
  std::vector<double> time_offset_s;
  double drag_per_m = 0.0;
  /// Whether a camera's pose is known at all; one that shares no flight with the others takes no
  /// part.
  std::vector<bool> is_placed;

  std::size_t cameras() const { return T_world_cam.size(); }

  /// Moves the state by a step of the rig's vector. Camera 1's rotation step is taken as a turn
  /// about world y and one about its own axis, which keeps its viewing direction in the x-z plane
  /// exactly.
  void apply(const Eigen::Ref<const Eigen::VectorXd>& step);
};

/// The two turns that camera 1 may make: about world y, about its viewing direction (3x2, world
/// axes).
Eigen::Matrix<double, 3, 2> camera_one_turns(const Rigid& T_world_cam1);

/// Columns: the free directions of the rig's vector. Camera 1 keeps its position and heading:
/// gravity fixes scale and the vertical, but no throw can say where the origin is or which way is
/// north. (rig_size x free)
Eigen::MatrixXd gauge_directions(const RigDescription& rig, const RigState& state);

/// A rig and the balls thrown at it: each at its throw's epoch on camera 1's clock, world axes.
struct Solution {
  RigState rig;
  std::vector<BallState> balls;
};

}  // namespace throwcal
