// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <Eigen/Core>
#include <optional>
#include <span>
#include <vector>

#include "estimator/ballistics.h"
#include "estimator/flight_fit.h"

/// The least squares under flight_fit: one flight against the rays of one camera.
namespace throwcal {

/// Parameters of one fit, camera axes, at time 0 of the rays: position, velocity, two tilts of
/// gravity, drag; the last three only where they are unknown.
struct FlightUnknowns {
  BallState ball;
  Eigen::Vector3d gravity;
  double drag = 0.0;
  bool tilts = true, drags = false;

  int count() const { return 6 + (tilts ? 2 : 0) + (drags ? 1 : 0); }
};

/// Two unit vectors square to `v`: the axes of gravity's tilts.
Eigen::Matrix<double, 3, 2> tangents(const Eigen::Vector3d& v);

/// What is known before the sightings; a sigma of 0 where it is not used.
struct FlightPrior {
  double drag = 0.0, sigma_drag = 0.0;
  Eigen::Vector3d gravity = Eigen::Vector3d::Zero();
  double sigma_gravity_rad = 0.0;
};

/// A least-squares problem: rays with times ascending, which of them count, and by what factor
/// their noise exceeds what they state.
struct RayProblem {
  std::span<const TimedRay> rays;
  const std::vector<bool>& used;
  double noise_scale = 1.0;
  FlightPrior prior;
};

struct RayEquations {
  Eigen::MatrixXd information;
  Eigen::VectorXd gradient;
};

/// Normal equations about x; Huber's weights, or (for the covariance) all ones.
RayEquations normal_equations(const RayProblem& problem, const FlightUnknowns& x, bool robust);

/// Whitened squared residual of each ray; infinite where the ball would be behind the ray.
std::vector<double> squared_residuals(std::span<const TimedRay> rays, const FlightUnknowns& x);

/// Smallest right singular vector of the stacked x_i x (P + V t + a t^2 / 2) = 0 over the rays
/// picked, scaled to |a| = g, the ball in front.
std::optional<FlightUnknowns> closed_form(std::span<const TimedRay> rays,
                                          std::span<const std::size_t> picked, double gravity_mps2);

/// With gravity known the same equations are linear in (P, V).
std::optional<FlightUnknowns> linear_form(std::span<const TimedRay> rays,
                                          std::span<const std::size_t> picked,
                                          const Eigen::Vector3d& gravity);

/// Levenberg-Marquardt on the Huber cost. False where it ran away.
bool descend(const RayProblem& problem, FlightUnknowns& x);

}  // namespace throwcal
