// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <Eigen/Core>
#include <vector>

#include "estimator/linearisation.h"

namespace throwcal {

/// Which sightings count, and the noise of each camera in units of what its whitening claims.
struct Weighting {
  PerSighting<char> used;
  std::vector<double> noise_scale;
  double huber_sigmas =
      0.0;  ///< residuals beyond it count linearly (Huber); 0: plain least squares
};

/// Sum of squared residuals of what is used, in units of the noise (Huber's where it is on).
double cost(const std::vector<TimedThrow>& throws, const PerSighting<Eigen::Vector2d>& residuals,
            const Weighting& weighting);

/// Gauss-Newton's normal equations, of minus half the cost: the rig's part, and each ball's, which
/// couples to the rig only. So memory and time grow linearly with the throws.
struct NormalEquations {
  using Matrix6 = Eigen::Matrix<double, 6, 6>;
  using Vector6 = Eigen::Matrix<double, 6, 1>;
  struct Ball {
    Matrix6 information = Matrix6::Zero();
    Eigen::Matrix<double, Eigen::Dynamic, 6> coupling;  ///< (layout's size x 6)
    Vector6 gradient = Vector6::Zero();
  };
  Eigen::MatrixXd information;  ///< of the rig's vector (layout's size, squared), balls held
  Eigen::VectorXd gradient;
  std::vector<Ball> balls;
};

/// `rig` is where `linear` was made.
NormalEquations normal_equations(const std::vector<TimedThrow>& throws, const Linearisation& linear,
                                 const RigState& rig, const RigLayout& layout,
                                 const Weighting& weighting);
NormalEquations normal_equations(const RigDescription& rig, const std::vector<TimedThrow>& throws,
                                 const Solution& at, const RigLayout& layout,
                                 const Weighting& weighting);

/// The same with the balls eliminated one by one (Schur complement).
struct ReducedEquations {
  Eigen::MatrixXd information;  ///< of the rig's vector, balls free to follow
  Eigen::VectorXd gradient;
  std::vector<NormalEquations::Matrix6> ball_root;  ///< R R^T: inverse of a ball's information

  /// How a ball follows a step of the rig's vector: (position, velocity) [m], [m/s].
  NormalEquations::Vector6 ball_step(const NormalEquations& normal, std::size_t ball,
                                     const Eigen::VectorXd& rig_step) const;
};

/// `damping` is Levenberg's, relative to the diagonal.
ReducedEquations eliminate_balls(const NormalEquations& normal, double damping);

/// What the rig's gradient, balls free, gains where all residuals of one camera move by so much.
/// Of plain least squares (no Huber), from the linearisation that `normal` and `reduced` are of.
Eigen::VectorXd gradient_of_shift(const std::vector<TimedThrow>& throws,
                                  const Linearisation& linear, const RigState& rig,
                                  const RigLayout& layout, const Weighting& weighting,
                                  const NormalEquations& normal, const ReducedEquations& reduced,
                                  CameraId camera, const Eigen::Vector2d& shift_px);

}  // namespace throwcal
