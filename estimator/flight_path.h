// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include "estimator/ballistics.h"

namespace throwcal {

/// One flight asked for at many times, with its sensitivities to the state at time 0. Times in
/// nearly ascending order are cheap: each is reached from the one before.
class FlightPath {
 public:
  /// `gravity` in the state's axes [m/s^2].
  FlightPath(const BallState& at_zero, const Eigen::Vector3d& gravity_mps2, double drag_per_m,
             bool wants_drag_derivative)
      : at_zero_(at_zero),
        gravity_mps2_(gravity_mps2),
        drag_per_m_(drag_per_m),
        is_parabola_(drag_per_m == 0.0 && !wants_drag_derivative),
        now_{at_zero, Eigen::Matrix3d::Zero(), Eigen::Matrix3d::Identity(), Eigen::Vector3d::Zero(),
             Eigen::Vector3d::Zero()} {}

  /// The ball at a time [s] from time 0, and its derivatives by velocity and drag. Valid until the
  /// next call.
  const Propagation& at(double time_s);

 private:
  BallState at_zero_;
  Eigen::Vector3d gravity_mps2_;
  double drag_per_m_;
  bool is_parabola_;
  double time_s_ = 0.0;
  Propagation now_;
};

}  // namespace throwcal
