// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <Eigen/Core>
#include <vector>

#include "estimator/normal_equations.h"

namespace throwcal {

struct RefinementSettings {
  int max_iterations =
      60;  ///< of each of the two descents; 0: leave the solution where it is and only judge it
  double huber_sigmas = 2.5;  ///< while outliers are still looked for
  double gate_chi2 =
      28.0;  ///< of two degrees of freedom: a true sighting fails once in 1.2 million
  double max_gated =
      0.1;  ///< more than this share of misfits is no outliers: the model is wrong, so all are kept
};

/// All throws at once: robust least squares over everything the sightings depend on, and its honest
/// covariance, in which every sighting counts once.
struct Refinement {
  Solution solution;
  RigLayout layout;  ///< of the rig's vector
  Weighting
      weighting;  ///< which sightings were used, and the noise found (1 where sigma was stated)
  PerSighting<Eigen::Vector2d> residuals;  ///< at the solution, in units of the claimed noise
  Eigen::MatrixXd covariance;              ///< of the rig's vector
  Eigen::MatrixXd information;             ///< of the rig's vector, balls eliminated
  std::vector<Eigen::VectorXd>
      undetermined;  ///< directions of the rig's vector that the sightings say nothing about
  double chi2 = 0.0;
  int degrees_of_freedom = 0;
  int iterations = 0;  ///< linearisations that it took
};

Refinement refine(const RigDescription& rig, const std::vector<TimedThrow>& throws,
                  const Solution& start, const RefinementSettings& settings = {});

}  // namespace throwcal
