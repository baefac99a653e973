// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/flight_path.h"

namespace throwcal {

const Propagation& FlightPath::at(double time_s) {
  if (is_parabola_) {
    now_.state = fly(at_zero_, time_s, gravity_mps2_, 0.0);
    now_.J_position_velocity0 = time_s * Eigen::Matrix3d::Identity();
    return now_;
  }
  const Propagation step = propagate(now_.state, time_s - time_s_, gravity_mps2_, drag_per_m_);
  // Chain rule, position before velocity: the first two need the velocity's derivative from before
  // the step.
  now_.J_position_velocity0 += step.J_position_velocity0 * now_.J_velocity_velocity0;
  now_.J_position_drag += step.J_position_velocity0 * now_.J_velocity_drag + step.J_position_drag;
  now_.J_velocity_drag = step.J_velocity_velocity0 * now_.J_velocity_drag + step.J_velocity_drag;
  now_.J_velocity_velocity0 = step.J_velocity_velocity0 * now_.J_velocity_velocity0;
  now_.state = step.state;
  time_s_ = time_s;
  return now_;
}

}  // namespace throwcal
