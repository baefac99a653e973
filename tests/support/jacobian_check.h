// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <functional>

namespace throwcal::test {

/// The one Jacobian checker: compares an analytic Jacobian with central differences, column by
/// column. `f` maps a step of the parameters (n) away from the point to the value (m). The
/// tolerance is relative to the largest element.
inline void expect_jacobian(const std::function<Eigen::VectorXd(const Eigen::VectorXd&)>& f,
                            const Eigen::MatrixXd& analytic, double step = 1e-6,
                            double tolerance = 1e-6) {
  Eigen::MatrixXd numeric(analytic.rows(), analytic.cols());
  for (Eigen::Index i = 0; i < analytic.cols(); ++i) {
    Eigen::VectorXd d = Eigen::VectorXd::Zero(analytic.cols());
    d[i] = step;
    numeric.col(i) = (f(d) - f(-d)) / (2 * step);
  }
  const double scale = std::max(1.0, analytic.cwiseAbs().maxCoeff());
  EXPECT_LT((numeric - analytic).cwiseAbs().maxCoeff(), tolerance * scale)
      << "analytic\n"
      << analytic << "\nnumeric\n"
      << numeric;
}

}  // namespace throwcal::test
