// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <Eigen/Core>
#include <functional>
#include <vector>

#include "estimator/rig_description.h"
#include "estimator/super_state.h"
#include "estimator/throw_set.h"

namespace throwcal {

/// A number for every sighting of every throw, in the order of the throws.
template <typename T>
using PerSighting = std::vector<std::vector<T>>;

/// Which sightings count, and the noise of each camera in units of what its whitening claims.
struct Weighting {
  PerSighting<char> used;
  std::vector<double> noise_scale;
  double huber_sigmas =
      0.0;  ///< residuals beyond it count linearly (Huber); 0: plain least squares
};

/// Gauss-Newton's normal equations with the balls eliminated throw by throw (Schur complement): the
/// throws couple only through the rig, so the cost grows linearly with them.
struct NormalEquations {
  struct Ball {
    Eigen::Matrix<double, 6, 6> inverse_information;
    Eigen::Matrix<double, Eigen::Dynamic, 6> coupling;  ///< (rig_size x 6)
    Eigen::Matrix<double, 6, 1> gradient;
  };
  Eigen::MatrixXd information;  ///< of the rig's vector, balls eliminated (rig_size x rig_size)
  Eigen::VectorXd gradient;     ///< the same, of minus half the cost
  std::vector<Ball> balls;
  double cost = 0.0;  ///< sum of squared whitened residuals (Huber's where it is on)
  int sightings = 0;  ///< that counted
};

/// Residuals, whitened by the claimed noise and the camera's scale; NaN where the ball cannot be
/// seen.
PerSighting<Eigen::Vector2d> whitened_residuals(const RigDescription& rig,
                                                const std::vector<TimedThrow>& throws,
                                                const Solution& at,
                                                const std::vector<double>& noise_scale);

/// `damping` is Levenberg's, relative to the diagonal.
NormalEquations normal_equations(const RigDescription& rig, const std::vector<TimedThrow>& throws,
                                 const Solution& at, const Weighting& weighting, double damping);

/// The cost alone.
double cost(const RigDescription& rig, const std::vector<TimedThrow>& throws, const Solution& at,
            const Weighting& weighting);

}  // namespace throwcal
