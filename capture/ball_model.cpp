// SPDX-License-Identifier: BSD-3-Clause
#include "capture/ball_model.h"

#include <algorithm>
#include <cmath>

namespace throwcal {
namespace {

constexpr int max_sub_exposures = 8;
constexpr double limb_px = 0.3;
constexpr double soft_grey = 6.0;    ///< width of the edge of the ball's own shadow
constexpr double max_stretch = 1.5;  ///< of an outline's form: an ellipse of axes 2.2 to 1

/// The shade at a surface normal and how it depends on it.
struct Shade {
  Eigen::Vector3d normal, by_normal;
  double grey, by_sun;  ///< by_sun: how much of the sun reaches there, 0 to 1
  bool is_limb;

  /// A pixel at the limb averages over normals: there h is not less than sqrt(limb / radius).
  Shade(double x, double y, const BallModel::Vector& p) {
    const double h2 = 1 - x * x - y * y, least = limb_px / p[BallModel::radius];
    is_limb = h2 < least;
    normal = {x, y, std::sqrt(is_limb ? least : h2)};
    const Eigen::Vector3d sky = p.segment<3>(BallModel::sky), sun = p.segment<3>(BallModel::sun);
    const double facing = sun.dot(normal),
                 softened = std::sqrt(facing * facing + soft_grey * soft_grey);
    by_sun = 0.5 * (1 + facing / softened);
    grey = p[BallModel::level] + sky.dot(normal) + 0.5 * (facing + softened);
    by_normal = sky + by_sun * sun;
  }
  /// Derivative by x and y, where h follows from them.
  Eigen::Vector2d slope() const {
    const double by_h = is_limb ? 0.0 : by_normal.z() / normal.z();
    return by_normal.head<2>() - by_h * normal.head<2>();
  }
};

/// A streak is summed in steps of a pixel; of a large ball a quarter of its radius is fine enough.
int steps_of(double streak_px, double radius_px) {
  if (streak_px == 0.0) return 1;
  const double step_px = std::max(1.0, 0.25 * radius_px);
  return std::clamp(static_cast<int>(std::ceil(streak_px / step_px)) + 1, 2, max_sub_exposures);
}

}  // namespace

int BallModel::sub_exposures(const Vector& p) {
  return steps_of(p.segment<2>(streak).norm(), p[radius]);
}

double BallModel::difference(const Eigen::Vector2d& pixel, double behind, const Vector& p,
                             Vector& derivative) const {
  const Eigen::Vector2d moved = p.segment<2>(streak);
  const double r = p[radius];
  const double streak_px = moved.norm();
  derivative.setZero();
  const Eigen::Vector2d from_middle = on_circle(pixel, p);
  if (from_middle.norm() > r + 0.5 + max_stretch * 0.5 * streak_px) return 0.0;
  const int n = steps_of(streak_px, r);
  const double share = 1.0 / n;
  const Eigen::Vector2d step = to_circle_ * moved;
  double sum = 0;
  for (int i = 0; i < n; ++i) {
    const double phase = (i + 0.5) * share - 0.5;
    const Eigen::Vector2d off = from_middle - phase * step;
    const double distance = off.norm(), coverage = std::clamp(0.5 + r - distance, 0.0, 1.0);
    if (coverage == 0.0) continue;
    // A pixel on the outline shows the part of the ball that it covers: half its coverage inside.
    const double inward = coverage < 1.0 ? (r - 0.5 * coverage) / (distance * r) : 1.0 / r;
    const Shade shade(inward * off.x(), inward * off.y(), p);
    const double contrast = shade.grey - behind, weight = share * coverage;
    sum += weight * contrast;
    derivative[level] += weight;
    derivative.segment<3>(sky) += weight * shade.normal;
    derivative.segment<3>(sun) += weight * shade.by_sun * shade.normal;
    Eigen::Vector2d by_off = weight / r * shade.slope();
    double by_radius = -by_off.dot(off) / r;
    if (coverage < 1.0) {
      by_off -= share * contrast / distance * off;
      by_radius += share * contrast;
    }
    const Eigen::Vector2d by_centre = -to_circle_ * by_off;
    derivative.segment<2>(centre) += by_centre;
    derivative.segment<2>(streak) += phase * by_centre;
    derivative[radius] += by_radius;
  }
  return sum;
}

Eigen::Vector2d BallModel::beside(const Eigen::Vector2d& pixel, const Vector& p,
                                  double margin_px) const {
  const Eigen::Vector2d towards = on_circle(pixel, p).normalized();
  const Eigen::Vector2d moved = to_circle_ * p.segment<2>(streak);
  const double reach = p[radius] + 0.5 * std::abs(towards.dot(moved)) + margin_px;
  return p.segment<2>(centre) + form_ * (reach * towards);
}

}  // namespace throwcal
