// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>

namespace throwcal {

/// T_a_b: maps coordinates in frame b to coordinates in frame a, p_a = T_a_b * p_b. Neighbouring
/// letters must match: T_a_c = T_a_b * T_b_c. The translation is b's origin in a.
struct Rigid {
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  Eigen::Vector3d operator*(const Eigen::Vector3d& point) const {
    return rotation * point + translation;
  }
  Rigid operator*(const Rigid& other) const {
    return {rotation * other.rotation, rotation * other.translation + translation};
  }
  Rigid inverse() const { return {rotation.transpose(), -(rotation.transpose() * translation)}; }
};

/// Cross-product matrix: skew(a) * b = a x b.
inline Eigen::Matrix3d skew(const Eigen::Vector3d& a) {
  Eigen::Matrix3d m;
  m << 0, -a.z(), a.y(), a.z(), 0, -a.x(), -a.y(), a.x(), 0;
  return m;
}

/// Rotation matrix of a rotation vector [rad] (Rodrigues).
Eigen::Matrix3d exp_so3(const Eigen::Vector3d& rotation_vector);

/// Rotation vector [rad] of a rotation matrix, of length at most pi.
Eigen::Vector3d log_so3(const Eigen::Matrix3d& rotation);

/// Nearest rotation matrix in the Frobenius norm: takes back what rounding did to a long product.
Eigen::Matrix3d nearest_rotation(const Eigen::Matrix3d& matrix);

/// T_world_cam of a camera at `centre` that looks at `target`, image upright, then rolled about its
/// axis (right-handed about the viewing direction) [rad]. World z is up. Looking straight up or
/// down has no upright image: assertion.
Rigid look_at(const Eigen::Vector3d& centre, const Eigen::Vector3d& target, double roll_rad = 0.0);

}  // namespace throwcal
