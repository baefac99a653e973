// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <Eigen/Core>

namespace throwcal {

/// Position [m] and velocity [m/s] of a ball, in whatever frame its caller names.
struct BallState {
  Eigen::Vector3d position_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d velocity_mps = Eigen::Vector3d::Zero();
};

/// No throw is in the air for longer, and nothing is asked of a flight farther from its known
/// state: integrating there would only take for ever.
constexpr double max_flight_s = 30.0;

/// A state after a step, and how it depends on what came before.
/// d position / d position0 is the identity and d velocity / d position0 zero: no force depends on
/// where the ball is.
struct Propagation {
  BallState state;
  Eigen::Matrix3d J_position_velocity0;  ///< [s]
  Eigen::Matrix3d J_velocity_velocity0;  ///< [1]
  Eigen::Vector3d J_position_drag;       ///< [m per 1/m]
  Eigen::Vector3d J_velocity_drag;       ///< [m/s per 1/m]
};

/// Flight through still air: a = gravity - drag * |v| * v, over a step of either sign [s].
/// `gravity` is in the state's frame [m/s^2]. Closed form without drag; with it, classical
/// Runge-Kutta on the state and its variational equations, steps of at most 25 ms: after a
/// second under 1 um of error for a table-tennis ball at 12 m/s, 10 nm for a tennis ball.
Propagation propagate(const BallState& state, double step_s, const Eigen::Vector3d& gravity_mps2,
                      double drag_per_m);

/// Further on: the derivatives stay by the state that `from` began at.
Propagation propagate_on(const Propagation& from, double step_s,
                         const Eigen::Vector3d& gravity_mps2, double drag_per_m);

/// The state alone; cheaper where no derivative is wanted.
BallState fly(const BallState& state, double step_s, const Eigen::Vector3d& gravity_mps2,
              double drag_per_m);

/// drag_per_m = rho C_d A / (2 m) of a sphere in air of the ISA standard atmosphere at an altitude
/// [m].
double sphere_drag_per_m(double diameter_m, double mass_kg, double drag_coefficient,
                         double altitude_m);

/// WGS 84 normal gravity [m/s^2] at a geodetic latitude [rad] and height above the ellipsoid [m]
/// (Somigliana's formula and its second-order height term, NIMA TR8350.2, eqs. 4-1 and 4-3).
double normal_gravity_mps2(double latitude_rad, double height_m);

}  // namespace throwcal
