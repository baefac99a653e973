// SPDX-License-Identifier: BSD-3-Clause
#include "capture/sphere_outline.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace throwcal {
namespace {

constexpr std::size_t corners = 24;
using Polygon = std::array<Eigen::Vector2d, corners>;

/// Pixels of the circle along which rays touch a sphere.
std::optional<Polygon> touching_circle(const CameraModel& model, const Eigen::Vector3d& centre_m,
                                       double radius_m) {
  const double distance = centre_m.norm(), sine2 = std::pow(radius_m / distance, 2);
  const Eigen::Vector3d axis = centre_m / distance;
  const Eigen::Vector3d side = axis.unitOrthogonal(), other = axis.cross(side);
  Polygon polygon;
  for (std::size_t i = 0; i < corners; ++i) {
    const double turn = 2 * std::numbers::pi * static_cast<double>(i) / corners;
    const auto pixel = model.project(centre_m * (1 - sine2) +
                                     radius_m * std::sqrt(1 - sine2) *
                                         (std::cos(turn) * side + std::sin(turn) * other));
    if (!pixel) return std::nullopt;
    polygon[i] = *pixel;
  }
  return polygon;
}

struct Moments {
  double area_px2;
  Eigen::Vector2d centroid_px;
  Eigen::Matrix2d spread_px2;
};

/// Of a polygon seen from a point inside it: sums over the triangles between them.
Moments moments(const Polygon& polygon, const Eigen::Vector2d& inside) {
  double area = 0;
  Eigen::Vector2d first = Eigen::Vector2d::Zero();
  Eigen::Matrix2d second = Eigen::Matrix2d::Zero();
  for (std::size_t i = 0; i < corners; ++i) {
    const Eigen::Vector2d a = polygon[i] - inside, b = polygon[(i + 1) % corners] - inside;
    const double triangle = 0.5 * (a.x() * b.y() - a.y() * b.x());
    area += triangle;
    first += triangle / 3 * (a + b);
    second +=
        triangle / 12 * (a * a.transpose() + b * b.transpose() + (a + b) * (a + b).transpose());
  }
  const Eigen::Vector2d mean = first / area;
  return {std::abs(area), inside + mean, second / area - mean * mean.transpose()};
}

}  // namespace

std::optional<SphereOutline> sphere_outline(const CameraModel& model, double diameter_m,
                                            const Eigen::Vector2d& pixel, double radius_px) {
  const auto ray = model.unproject(pixel);
  if (!ray) return std::nullopt;
  const auto centre = model.project(*ray);
  if (!centre) return std::nullopt;
  double sine = radius_px / std::sqrt(model.fx_px * model.fy_px);
  std::optional<Moments> seen;
  for (int i = 0; i < 2; ++i) {  // the distance at which it is as large as it looks
    sine = std::clamp(sine, 1e-6, 0.7);
    const auto polygon = touching_circle(model, 0.5 * diameter_m / sine * *ray, 0.5 * diameter_m);
    if (!polygon) return std::nullopt;
    seen = moments(*polygon, *centre);
    sine *= radius_px / std::sqrt(seen->area_px2 / std::numbers::pi);
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> spread(seen->spread_px2);
  const Eigen::Matrix2d root = spread.operatorSqrt();
  return SphereOutline{seen->centroid_px - *centre, root / std::sqrt(root.determinant())};
}

}  // namespace throwcal
