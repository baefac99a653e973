// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/ballistics.h"

#include <cmath>
#include <numbers>

#include "estimator/elementary.h"

namespace throwcal {
namespace {

constexpr double max_step_s = 0.025;

Eigen::Vector3d acceleration(const Eigen::Vector3d& velocity, const Eigen::Vector3d& gravity,
                             double drag) {
  return gravity - drag * velocity.norm() * velocity;
}

/// Slopes of (velocity, d velocity / d velocity0, d velocity / d drag); the position's are the
/// velocity's own.
struct Variation {
  Eigen::Vector3d velocity;
  Eigen::Matrix3d J_velocity0;
  Eigen::Vector3d J_drag;

  Variation along(double h, const Variation& slope) const {
    return {velocity + h * slope.velocity, J_velocity0 + h * slope.J_velocity0,
            J_drag + h * slope.J_drag};
  }
};

Variation slope_of(const Variation& at, const Eigen::Vector3d& gravity, double drag) {
  const double speed = at.velocity.norm();
  Eigen::Matrix3d dynamics =
      -drag * speed * Eigen::Matrix3d::Identity();  // d acceleration / d velocity
  if (speed > 1e-12) dynamics -= drag / speed * at.velocity * at.velocity.transpose();
  return {acceleration(at.velocity, gravity, drag), dynamics * at.J_velocity0,
          dynamics * at.J_drag - speed * at.velocity};
}

Variation weighted(const Variation& a, const Variation& b, const Variation& c, const Variation& d) {
  const auto mean = [](const auto& p, const auto& q, const auto& r, const auto& s) {
    return ((p + 2.0 * q + 2.0 * r + s) / 6.0).eval();
  };
  return {mean(a.velocity, b.velocity, c.velocity, d.velocity),
          mean(a.J_velocity0, b.J_velocity0, c.J_velocity0, d.J_velocity0),
          mean(a.J_drag, b.J_drag, c.J_drag, d.J_drag)};
}

/// One Runge-Kutta step of the variational equations.
void advance(Eigen::Vector3d& position, Eigen::Matrix3d& J_position,
             Eigen::Vector3d& J_position_drag, Variation& v, double h,
             const Eigen::Vector3d& gravity, double drag) {
  const Variation k1 = slope_of(v, gravity, drag), v2 = v.along(0.5 * h, k1);
  const Variation k2 = slope_of(v2, gravity, drag), v3 = v.along(0.5 * h, k2);
  const Variation k3 = slope_of(v3, gravity, drag), v4 = v.along(h, k3);
  const Variation k4 = slope_of(v4, gravity, drag);
  const Variation mean_rate = weighted(v, v2, v3, v4);
  position += h * mean_rate.velocity;
  J_position += h * mean_rate.J_velocity0;
  J_position_drag += h * mean_rate.J_drag;
  v = v.along(h, weighted(k1, k2, k3, k4));
}

int step_count(double step_s) {
  if (!(std::abs(step_s) <= 10 * max_flight_s)) return 1;  // no ball is followed that far
  return std::max(1, static_cast<int>(std::ceil(std::abs(step_s) / max_step_s - 1e-9)));
}

}  // namespace

Propagation propagate(const BallState& state, double step_s, const Eigen::Vector3d& gravity_mps2,
                      double drag_per_m) {
  return propagate_on({state, Eigen::Matrix3d::Zero(), Eigen::Matrix3d::Identity(),
                       Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()},
                      step_s, gravity_mps2, drag_per_m);
}

Propagation propagate_on(const Propagation& from, double step_s,
                         const Eigen::Vector3d& gravity_mps2, double drag_per_m) {
  Propagation out = from;
  if (step_s == 0.0) return out;
  Variation v{from.state.velocity_mps, from.J_velocity_velocity0, from.J_velocity_drag};
  const int steps = step_count(step_s);
  for (int i = 0; i < steps; ++i)
    advance(out.state.position_m, out.J_position_velocity0, out.J_position_drag, v, step_s / steps,
            gravity_mps2, drag_per_m);
  out.state.velocity_mps = v.velocity;
  out.J_velocity_velocity0 = v.J_velocity0;
  out.J_velocity_drag = v.J_drag;
  return out;
}

BallState fly(const BallState& state, double step_s, const Eigen::Vector3d& gravity_mps2,
              double drag_per_m) {
  if (drag_per_m == 0.0)
    return {state.position_m + step_s * state.velocity_mps + 0.5 * step_s * step_s * gravity_mps2,
            state.velocity_mps + step_s * gravity_mps2};
  BallState out = state;
  const int steps = step_count(step_s);
  const double h = step_s / steps;
  for (int i = 0; i < steps; ++i) {
    const Eigen::Vector3d v1 = out.velocity_mps, a1 = acceleration(v1, gravity_mps2, drag_per_m);
    const Eigen::Vector3d v2 = v1 + 0.5 * h * a1, a2 = acceleration(v2, gravity_mps2, drag_per_m);
    const Eigen::Vector3d v3 = v1 + 0.5 * h * a2, a3 = acceleration(v3, gravity_mps2, drag_per_m);
    const Eigen::Vector3d v4 = v1 + h * a3, a4 = acceleration(v4, gravity_mps2, drag_per_m);
    out.position_m += h / 6.0 * (v1 + 2.0 * v2 + 2.0 * v3 + v4);
    out.velocity_mps += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4);
  }
  return out;
}

double sphere_drag_per_m(double diameter_m, double mass_kg, double drag_coefficient,
                         double altitude_m) {
  // ISA troposphere: T = 288.15 - 0.0065 h, p = 101325 (T / 288.15)^5.2559, rho = p / (287.05 T).
  const double temperature_k = 288.15 - 0.0065 * altitude_m;
  const double pressure_pa =
      101325.0 * elementary::exp(5.2559 * elementary::log(temperature_k / 288.15));
  const double density = pressure_pa / (287.05287 * temperature_k);
  const double area_m2 = 0.25 * std::numbers::pi * diameter_m * diameter_m;
  return density * drag_coefficient * area_m2 / (2.0 * mass_kg);
}

double normal_gravity_mps2(double latitude_rad, double height_m) {
  constexpr double equator = 9.7803253359, k = 0.00193185265241, e2 = 0.00669437999014;
  constexpr double a_m = 6378137.0, f = 1.0 / 298.257223563, m = 0.00344978650684;
  const double s2 = square(elementary::sin(latitude_rad));
  const double at_ellipsoid = equator * (1 + k * s2) / std::sqrt(1 - e2 * s2);
  return at_ellipsoid * (1 - 2 / a_m * (1 + f + m - 2 * f * s2) * height_m +
                         3 / (a_m * a_m) * height_m * height_m);
}

}  // namespace throwcal
