// SPDX-License-Identifier: BSD-3-Clause
#include "capture/ball_model.h"

#include "tests/support/jacobian_check.h"

namespace throwcal {
namespace {

TEST(BallModel, ItsDerivativeInsideTheOutlineIsThePicturesChange) {
  Eigen::Matrix2d form;
  form << 1.05, 0.02, 0.02, (1 + 0.02 * 0.02) / 1.05;
  const BallModel model(form);
  BallModel::Vector p;
  p << 100.3, 80.7, 0.8, -0.4, 12.0, 90.0, 10, -20, 30, 40, 25, 60;
  for (const Eigen::Vector2d& pixel :
       {Eigen::Vector2d(100, 81), Eigen::Vector2d(104, 78), Eigen::Vector2d(96, 85)}) {
    BallModel::Vector derivative, ignored;
    model.difference(pixel, 35.0, p, derivative);
    test::expect_jacobian(
        [&](const Eigen::VectorXd& d) {
          return Eigen::VectorXd::Constant(1, model.difference(pixel, 35.0, p + d, ignored));
        },
        derivative.transpose(), 1e-5, 1e-5);
  }
}

}  // namespace
}  // namespace throwcal
