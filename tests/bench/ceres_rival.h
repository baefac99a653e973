// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <ceres/ceres.h>

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "estimator/rig_description.h"
#include "estimator/super_state.h"
#include "estimator/throw_set.h"

namespace throwcal::bench {

/// What makes Ceres fast or slow on a problem; the defaults are the fastest found (README.md).
struct CeresChoice {
  ceres::LinearSolverType solver = ceres::DENSE_SCHUR;
  ceres::DenseLinearAlgebraLibraryType dense = ceres::EIGEN;
  ceres::SparseLinearAlgebraLibraryType sparse = ceres::SUITE_SPARSE;
  ceres::CovarianceAlgorithmType covariance = ceres::SPARSE_QR;
  ceres::SparseLinearAlgebraLibraryType covariance_sparse = ceres::SUITE_SPARSE;
  int threads = 1;
  bool jacobi_scaling = true;
  double first_radius = 1e10;
  double function_tolerance = 1e-6;
};

/// The joint refinement's last problem in Ceres: all sightings, each once, plain least squares (the
/// gate takes none of these out), the same residuals and the same analytic Jacobians: those of our
/// own linearise(), called once an evaluation by an EvaluationCallback.
class CeresRival {
 public:
  CeresRival(const RigDescription& rig, const std::vector<TimedThrow>& throws,
             const Solution& start, const CeresChoice& choice = {});
  ~CeresRival();

  void set_start(const Solution& start);
  ceres::Solver::Summary solve();
  /// Of the rig's whole vector, in RigLayout's order. Empty where Ceres fails.
  Eigen::MatrixXd covariance();

  Solution solution() const;
  double cost() const;  ///< as ours: the sum of squares, not its half

 private:
  class Shared;
  std::unique_ptr<Shared> shared_;
  std::unique_ptr<ceres::Problem> problem_;
  ceres::Solver::Options options_;
  CeresChoice choice_;
};

}  // namespace throwcal::bench
