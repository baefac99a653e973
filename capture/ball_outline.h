// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <Eigen/Core>

namespace throwcal {

/// A ball's outline as it moved through one exposure.
struct BallOutline {
  Eigen::Vector2d centre_px = Eigen::Vector2d::Zero();  ///< of the outline, at mid-exposure
  double radius_px = 0.0;                               ///< of the circle of the outline's area
  Eigen::Vector2d streak_px = Eigen::Vector2d::Zero();  ///< movement during the exposure
};

}  // namespace throwcal
