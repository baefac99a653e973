// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/rigid.h"

#include <Eigen/SVD>
#include <cassert>
#include <cmath>

#include "estimator/elementary.h"

namespace throwcal {

Eigen::Matrix3d exp_so3(const Eigen::Vector3d& rotation_vector) {
  const double angle2 = rotation_vector.squaredNorm();
  double sinc, versine;  // sin(a) / a, (1 - cos(a)) / a^2
  if (angle2 < 0.01) {   // series to a^10: the first term left out is below 1e-17
    sinc = 1 - angle2 / 6 * (1 - angle2 / 20 * (1 - angle2 / 42 * (1 - angle2 / 72)));
    versine = 0.5 * (1 - angle2 / 12 * (1 - angle2 / 30 * (1 - angle2 / 56 * (1 - angle2 / 90))));
  } else {
    const double angle = std::sqrt(angle2);
    sinc = elementary::sin(angle) / angle;
    versine = (1 - elementary::cos(angle)) / angle2;
  }
  const Eigen::Matrix3d turn = skew(rotation_vector);
  Eigen::Matrix3d out = versine * turn.lazyProduct(turn) + sinc * turn;
  out.diagonal().array() += 1.0;
  return out;
}

Eigen::Vector3d log_so3(const Eigen::Matrix3d& rotation) {
  // By way of the quaternion: well conditioned at every angle, pi included, unlike acos of the
  // trace.
  Eigen::Quaterniond q(rotation);
  if (q.w() < 0) q.coeffs() = -q.coeffs();
  const double sine = q.vec().norm();
  if (sine < 1e-12) return 2.0 * q.vec();
  return 2.0 * elementary::atan2(sine, q.w()) / sine * q.vec();
}

Eigen::Matrix3d nearest_rotation(const Eigen::Matrix3d& matrix) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(matrix, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d u = svd.matrixU();
  if ((u * svd.matrixV().transpose()).determinant() < 0) u.col(2) = -u.col(2);
  return u * svd.matrixV().transpose();
}

Rigid look_at(const Eigen::Vector3d& centre, const Eigen::Vector3d& target, double roll_rad) {
  const Eigen::Vector3d forward = (target - centre).normalized();
  const Eigen::Vector3d side = forward.cross(Eigen::Vector3d::UnitZ());
  assert(side.norm() > 1e-9);
  const Eigen::Vector3d right = side.normalized();
  Eigen::Matrix3d level;
  level << right, forward.cross(right), forward;
  return {level * exp_so3({0.0, 0.0, roll_rad}), centre};
}

}  // namespace throwcal
