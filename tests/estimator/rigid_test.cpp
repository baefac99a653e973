// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/rigid.h"

#include <gtest/gtest.h>

#include <numbers>

namespace throwcal {
namespace {

TEST(Rigid, LogUndoesExpUpToPi) {
  for (double angle : {0.0, 1e-12, 1e-6, 0.3, 2.0, std::numbers::pi - 1e-7}) {
    const Eigen::Vector3d r = angle * Eigen::Vector3d(1, -2, 0.5).normalized();
    EXPECT_LT((log_so3(exp_so3(r)) - r).norm(), 1e-9) << angle;
  }
}

TEST(Rigid, InverseUndoes) {
  const Rigid T{exp_so3({0.3, -1, 2}), {1, 2, 3}};
  const Rigid identity = T * T.inverse();
  EXPECT_LT((identity.rotation - Eigen::Matrix3d::Identity()).norm() + identity.translation.norm(),
            1e-14);
  const Eigen::Vector3d p(4, 5, 6);
  EXPECT_LT((T.inverse() * (T * p) - p).norm(), 1e-14);
}

TEST(Rigid, ACameraThatLooksAlongXHasItsRightHandSideToMinusY) {
  const Rigid T = look_at({0, 0, 1}, {5, 0, 1});
  EXPECT_LT((T.rotation.col(0) - Eigen::Vector3d(0, -1, 0)).norm(), 1e-15);  // image right
  EXPECT_LT((T.rotation.col(1) - Eigen::Vector3d(0, 0, -1)).norm(), 1e-15);  // image down
  EXPECT_LT((T.rotation.col(2) - Eigen::Vector3d(1, 0, 0)).norm(), 1e-15);   // forward
}

}  // namespace
}  // namespace throwcal
