// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/camera_model.h"

#include <Eigen/Dense>
#include <cmath>
#include <limits>
#include <numbers>

#include "estimator/elementary.h"

namespace throwcal {
namespace {

constexpr double min_depth_m = 1e-6;
constexpr int max_newton_steps = 30;

/// Smallest r > 0 where d/dr (r + c1 r^3 + c2 r^5 + ...) is zero, or infinity. Marches to the first
/// change of sign.
double first_turning_point(const double* c, int n, double limit) {
  const auto slope = [&](double r) {
    double sum = 1.0, power = 1.0;
    for (int i = 0; i < n; ++i) sum += (2 * i + 3) * c[i] * (power *= r * r);
    return sum;
  };
  constexpr int steps = 256;  // fine enough for polynomials of such low order, and asked for often
  for (int i = 1; i <= steps; ++i) {
    if (slope(limit * i / steps) > 0) continue;
    double low = limit * (i - 1) / steps, high = limit * i / steps;
    for (int k = 0; k < 60; ++k) (slope(0.5 * (low + high)) > 0 ? low : high) = 0.5 * (low + high);
    return low;
  }
  return std::numeric_limits<double>::infinity();
}

/// Whether r + c1 r^3 + c2 r^5 + ... surely grows all the way up to r: true where even with every
/// number against it the slope stays positive. Spares nearly every ray the search for the turning
/// point.
bool surely_grows_to(double r, const double* c, int n) {
  double least = 1.0, power = 1.0;
  for (int i = 0; i < n; ++i) least -= (2 * i + 3) * std::abs(c[i]) * (power *= r * r);
  return least > 0;
}

/// OpenCV's radial and tangential model on normalised coordinates, and its 2x2 derivative.
inline Eigen::Vector2d distort_radtan(const std::array<double, 5>& d, const Eigen::Vector2d& p,
                                      Eigen::Matrix2d* J) {
  const auto [k1, k2, p1, p2, k3] = d;
  const double x = p.x(), y = p.y(), r2 = x * x + y * y;
  const double radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
  if (J) {
    const double slope = 2 * (k1 + r2 * (2 * k2 + 3 * r2 * k3));
    const double cross = x * y * slope + 2 * p1 * x + 2 * p2 * y;
    *J << radial + x * x * slope + 2 * p1 * y + 6 * p2 * x, cross, cross,
        radial + y * y * slope + 6 * p1 * y + 2 * p2 * x;
  }
  return {x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
          y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y};
}

/// The commonest projection, written out: everything else waits for it.
std::optional<Eigen::Vector2d> project_plain_radtan(const CameraModel& m,
                                                    const Eigen::Vector3d& point,
                                                    Eigen::Matrix<double, 2, 3>* J) {
  if (point.z() < min_depth_m) return std::nullopt;
  const double inverse = 1.0 / point.z(), x = point.x() * inverse, y = point.y() * inverse;
  const auto [k1, k2, p1, p2, k3] = m.distortion;
  const double xx = x * x, yy = y * y, xy = x * y, r2 = xx + yy;
  const double radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
  if (J) {
    const double slope = 2 * (k1 + r2 * (2 * k2 + 3 * r2 * k3));
    const double cross = xy * slope + 2 * (p1 * x + p2 * y);
    const double Dxx = radial + xx * slope + 2 * p1 * y + 6 * p2 * x;
    const double Dyy = radial + yy * slope + 6 * p1 * y + 2 * p2 * x;
    const double fx = m.fx_px * inverse, fy = m.fy_px * inverse, skew = m.skew_px * inverse;
    const double ux = fx * Dxx + skew * cross, uy = fx * cross + skew * Dyy;
    const double vx = fy * cross, vy = fy * Dyy;
    *J << ux, uy, -(ux * x + uy * y), vx, vy, -(vx * x + vy * y);
  }
  const double distorted_x = x * radial + 2 * p1 * xy + p2 * (r2 + 2 * xx);
  const double distorted_y = y * radial + p1 * (r2 + 2 * yy) + 2 * p2 * xy;
  return Eigen::Vector2d(m.fx_px * distorted_x + m.skew_px * distorted_y + m.cx_px,
                         m.fy_px * distorted_y + m.cy_px);
}

/// theta + k1 theta^3 + ... and its slope.
std::pair<double, double> bend_kb4(const std::array<double, 5>& k, double angle) {
  const double a2 = angle * angle;
  return {angle * (1 + a2 * (k[0] + a2 * (k[1] + a2 * (k[2] + a2 * k[3])))),
          1 + a2 * (3 * k[0] + a2 * (5 * k[1] + a2 * (7 * k[2] + a2 * 9 * k[3])))};
}

/// d distorted / d distortion's five numbers.
using DistortionJacobian = Eigen::Matrix<double, 2, 5>;

std::optional<Eigen::Vector2d> project_radtan(const CameraModel& model,
                                              const Eigen::Vector3d& point,
                                              Eigen::Matrix<double, 2, 3>* J,
                                              DistortionJacobian* J_distortion) {
  if (point.z() < min_depth_m) return std::nullopt;
  const double per_m = 1.0 / point.z();  // one division serves all
  const Eigen::Vector2d p(per_m * point.x(), per_m * point.y());
  if (J_distortion) {
    const double r2 = p.squaredNorm(), xy2 = 2 * p.x() * p.y();
    *J_distortion << r2 * p, r2 * r2 * p, Eigen::Vector2d(xy2, r2 + 2 * p.y() * p.y()),
        Eigen::Vector2d(r2 + 2 * p.x() * p.x(), xy2), r2 * r2 * r2 * p;
  }
  Eigen::Matrix2d D;
  const Eigen::Vector2d distorted = distort_radtan(model.distortion, p, J ? &D : nullptr);
  if (J)
    for (int i = 0; i < 2; ++i) {
      (*J)(i, 0) = per_m * D(i, 0), (*J)(i, 1) = per_m * D(i, 1);
      (*J)(i, 2) = -per_m * (D(i, 0) * p.x() + D(i, 1) * p.y());
    }
  return distorted;
}

std::optional<Eigen::Vector2d> project_kb4(const CameraModel& model, const Eigen::Vector3d& point,
                                           Eigen::Matrix<double, 2, 3>* J,
                                           DistortionJacobian* J_distortion) {
  if (J_distortion) J_distortion->setZero();
  const double radius = point.head<2>().norm(), range2 = point.squaredNorm();
  if (range2 < min_depth_m * min_depth_m) return std::nullopt;
  if (radius < 1e-9 * std::abs(point.z())) {  // on the axis the model is the pinhole
    if (point.z() <= 0) return std::nullopt;
    const Eigen::Vector2d p = point.head<2>() / point.z();
    if (J) *J << Eigen::Matrix2d::Identity() / point.z(), -p / point.z();
    return p;
  }
  const Eigen::Vector2d unit = point.head<2>() / radius;
  const double angle = elementary::atan2(radius, point.z());
  const auto [bent, slope] = bend_kb4(model.distortion, angle);
  if (J_distortion) {
    double power = angle;
    for (int i = 0; i < 4; ++i) J_distortion->col(i) = (power *= angle * angle) * unit;
  }
  if (J) {
    Eigen::RowVector3d angle_by_point;
    angle_by_point << unit.transpose() * (point.z() / range2), -radius / range2;
    *J = slope * unit * angle_by_point;
    J->leftCols<2>() += bent / radius * (Eigen::Matrix2d::Identity() - unit * unit.transpose());
  }
  return bent * unit;
}

std::optional<Eigen::Vector3d> ray_radtan(const CameraModel& model,
                                          const Eigen::Vector2d& distorted) {
  Eigen::Vector2d p = distorted;
  Eigen::Matrix2d J;
  for (int i = 0; i < max_newton_steps; ++i) {
    const Eigen::Vector2d error = distort_radtan(model.distortion, p, &J) - distorted;
    if (error.norm() < 1e-13) return p.homogeneous().normalized();
    if (!(std::abs(J.determinant()) > 1e-9)) return std::nullopt;
    p -= J.inverse() * error;
    if (!p.allFinite()) return std::nullopt;
  }
  const bool close = (distort_radtan(model.distortion, p, nullptr) - distorted).norm() < 1e-9;
  return close ? std::optional(Eigen::Vector3d(p.homogeneous().normalized())) : std::nullopt;
}

std::optional<Eigen::Vector3d> ray_kb4(const CameraModel& model, const Eigen::Vector2d& distorted) {
  const double bent = distorted.norm();
  if (bent < 1e-15) return Eigen::Vector3d::UnitZ();
  double max_angle = std::min(2 * bent, std::numbers::pi);
  if (!surely_grows_to(max_angle, model.distortion.data(), 4) ||
      bend_kb4(model.distortion, max_angle).first < bent)
    max_angle = model.max_angle_rad();
  // The bend grows up to max_angle: bisection brackets, Newton finishes.
  double low = 0.0, high = max_angle, angle = std::min(bent, 0.5 * max_angle);
  if (bend_kb4(model.distortion, high).first < bent) return std::nullopt;
  for (int i = 0; i < 100; ++i) {
    const auto [value, slope] = bend_kb4(model.distortion, angle);
    (value < bent ? low : high) = angle;
    double next = angle - (value - bent) / slope;
    if (!(next > low && next < high)) next = 0.5 * (low + high);
    if (std::abs(next - angle) < 1e-15) break;
    angle = next;
  }
  const Eigen::Vector2d unit = distorted / bent;
  return Eigen::Vector3d(elementary::sin(angle) * unit.x(), elementary::sin(angle) * unit.y(),
                         elementary::cos(angle));
}

}  // namespace

std::optional<Eigen::Vector2d> CameraModel::project(
    const Eigen::Vector3d& point_cam, Eigen::Matrix<double, 2, 3>* J_point,
    Eigen::Matrix<double, 2, lens_intrinsics>* J_intrinsics) const {
  if (lens == Lens::radtan && !J_intrinsics) return project_plain_radtan(*this, point_cam, J_point);
  DistortionJacobian J_distortion;
  const auto distort = lens == Lens::radtan ? project_radtan : project_kb4;
  const auto distorted = distort(*this, point_cam, J_point, J_intrinsics ? &J_distortion : nullptr);
  if (!distorted) return std::nullopt;
  if (J_point) {
    J_point->row(0) = fx_px * J_point->row(0) + skew_px * J_point->row(1);
    J_point->row(1) *= fy_px;
  }
  if (J_intrinsics) {
    const auto [x, y] = std::pair(distorted->x(), distorted->y());
    J_intrinsics->leftCols<5>() << x, 0, 1, 0, y,  //
        0, y, 0, 1, 0;
    J_intrinsics->row(0).tail<5>() = fx_px * J_distortion.row(0) + skew_px * J_distortion.row(1);
    J_intrinsics->row(1).tail<5>() = fy_px * J_distortion.row(1);
  }
  return Eigen::Vector2d(fx_px * distorted->x() + skew_px * distorted->y() + cx_px,
                         fy_px * distorted->y() + cy_px);
}

std::optional<Eigen::Vector3d> CameraModel::unproject(const Eigen::Vector2d& pixel) const {
  const double y = (pixel.y() - cy_px) / fy_px;
  const Eigen::Vector2d distorted((pixel.x() - cx_px - skew_px * y) / fx_px, y);
  if (lens == Lens::kb4) return ray_kb4(*this, distorted);
  const auto ray = ray_radtan(*this, distorted);
  if (!ray) return ray;
  const double radius = ray->head<2>().norm(), angle = elementary::atan2(radius, ray->z());
  const std::array<double, 3> radial{distortion[0], distortion[1], distortion[4]};
  const bool grows = angle < 1.5 && surely_grows_to(radius / ray->z(), radial.data(), 3);
  return grows || angle <= max_angle_rad() ? ray : std::nullopt;
}

double CameraModel::max_angle_rad() const {
  if (lens == Lens::kb4)
    return std::min(first_turning_point(distortion.data(), 4, std::numbers::pi), std::numbers::pi);
  const std::array<double, 3> radial{distortion[0], distortion[1], distortion[4]};
  const double limit = first_turning_point(radial.data(), 3, 10.0);
  return std::isfinite(limit) ? elementary::atan2(limit, 1) : 0.5 * std::numbers::pi - 1e-3;
}

double& CameraModel::at(Intrinsic which) {
  switch (which) {
    case Intrinsic::fx:
      return fx_px;
    case Intrinsic::fy:
      return fy_px;
    case Intrinsic::cx:
      return cx_px;
    case Intrinsic::cy:
      return cy_px;
    case Intrinsic::skew:
      return skew_px;
    case Intrinsic::row_time:
      return row_time_s;
    default:
      return distortion[static_cast<std::size_t>(which) - static_cast<std::size_t>(Intrinsic::d0)];
  }
}

bool CameraModel::contains(const Eigen::Vector2d& pixel, double margin_px) const {
  return pixel.x() >= margin_px && pixel.y() >= margin_px &&
         pixel.x() <= width_px - 1 - margin_px && pixel.y() <= height_px - 1 - margin_px;
}

std::string name_of(Intrinsic which, Lens lens) {
  static constexpr std::array<const char*, intrinsics> radtan{
      "fx_px", "fy_px", "cx_px", "cy_px", "skew_px", "k1", "k2", "p1", "p2", "k3", "row_time_s"};
  static constexpr std::array<const char*, intrinsics> kb4{
      "fx_px", "fy_px", "cx_px", "cy_px", "skew_px", "k1", "k2", "k3", "k4", "", "row_time_s"};
  return (lens == Lens::radtan ? radtan : kb4)[static_cast<std::size_t>(which)];
}

}  // namespace throwcal
