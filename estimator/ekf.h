// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <Eigen/Core>

#include "estimator/rig_description.h"
#include "estimator/super_state.h"
#include "estimator/throw_set.h"

namespace throwcal {

struct EkfSettings {
  /// 1-sigma that the filter believes of a centroid, as an angle (of fx pixels); throw_iteration.h
  /// says why it is so wide.
  double noise_rad = 0.035;
  double prior_rotation_rad = 0.3, prior_position_m = 0.5;  ///< of each camera
  double prior_offset_s = 0.02, prior_drag_per_m = 0.02;
  double prior_ball_position_m = 0.5, prior_ball_velocity_mps = 1.0;
  double process_acceleration_mps2 =
      0.02;  ///< wind and what else the flight model lacks: white noise on the velocity
  double pseudo_noise_variance =
      0.0;  ///< random walk of the rig's vector a second (thesis eq. 3.9); unit^2/s
  double huber_sigmas = 3.0;  ///< innovations beyond it pull only linearly
};

/// The extended Kalman filter of the thesis' Table 3.1 on the super-state [ball | rig] (eq. 4.10),
/// with the cameras' orientation as an error state on SO(3) in place of z-x-z angles, which are
/// singular for parallel cameras. A step allocates nothing.
class Ekf {
 public:
  Ekf(const RigDescription& rig, const RigState& start, const EkfSettings& settings);

  void reset_rig_covariance();  ///< to the wide prior
  void hold_rig();              ///< as known exactly: from now on only balls move
  void believe_noise(double noise_rad) { settings_.noise_rad = noise_rad; }  ///< from now on
  void start_throw(const BallState& ball);  ///< ball at time 0 of the throw, forgotten but for this

  void predict(double time_s);  ///< flies the ball to a time, of either sense
  /// Gated update with one sighting, at the moment its camera's present offset says; nothing where
  /// it cannot be seen.
  void update(const TimedSighting& sighting);

  const RigState& rig() const { return rig_state_; }
  const BallState& ball() const { return ball_; }
  const Eigen::MatrixXd& covariance() const { return covariance_; }  ///< of [ball | rig]

 private:
  /// P <- F P F^T with the ball's rows of F other than the identity's.
  void propagate_covariance(const Propagation& step);
  /// P H^T; H has two blocks only, the ball's position and the camera's slice.
  template <int camera_size>
  void cross_covariance(int at);

  const RigDescription& rig_;
  EkfSettings settings_;
  RigState rig_state_;
  RigLayout layout_;
  BallState ball_;
  double time_s_ = 0.0;
  Eigen::MatrixXd covariance_;  // (6 + layout's size)^2, exactly symmetric
  // Workspace, so that a step allocates nothing.
  SightingModel model_;
  RigLayout::CameraJacobian J_camera_;
  Eigen::Matrix<double, Eigen::Dynamic, 2> cross_, whitened_;
  Eigen::VectorXd step_;
};

}  // namespace throwcal
