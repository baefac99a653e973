// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <Eigen/Core>
#include <optional>

#include "estimator/camera_model.h"

namespace throwcal {

/// The picture of a sphere: nearly an ellipse, and not about the picture of its centre. Perspective
/// pushes it outwards by about f (r/Z)^2 tan(angle off the axis).
struct SphereOutline {
  Eigen::Vector2d
      offset_px;          ///< from the projection of the sphere's centre to its outline's centroid
  Eigen::Matrix2d shape;  ///< symmetric, determinant 1: times a circle, the outline's form
};

/// Outline of a ball of a diameter [m] whose picture is at `pixel` (within a pixel or so) and has
/// the area of a circle of `radius_px`. Nothing where the lens cannot see so much.
std::optional<SphereOutline> sphere_outline(const CameraModel& model, double diameter_m,
                                            const Eigen::Vector2d& pixel, double radius_px);

}  // namespace throwcal
