// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <Eigen/Core>

namespace throwcal {

/// What a shaded ball that moves during an exposure adds to a still background, pixel by pixel:
/// coverage x (shade - background).
///
/// Coverage follows the outline (a circle in coordinates that undo its form) along its streak.
/// Shade is what a matt sphere reflects towards the camera: under any lighting from afar that is,
/// within a per cent or so, a sum of spherical harmonics of the surface's normal up to the second
/// degree (Ramamoorthi and Hanrahan, 2001). So a lit side does not pull the centre.
class BallModel {
 public:
  enum Parameter : int { centre = 0, streak = 2, radius = 4, shade = 5 };  ///< first index of each
  static constexpr int shades = 9, size = shade + shades;  ///< shade: x y h: 1, x, y, h, xy, ...
  using Vector = Eigen::Matrix<double, size, 1>;

  /// `form`: symmetric, determinant 1: times a circle, the outline.
  explicit BallModel(const Eigen::Matrix2d& form) : form_(form), to_circle_(form.inverse()) {}

  /// Difference to the background [grey levels] at a pixel that shows `behind` without the ball,
  /// and its derivative by the parameters. The derivative by shade's first is the coverage.
  double difference(const Eigen::Vector2d& pixel, double behind, const Vector& p,
                    Vector& derivative) const;

  /// From the centre as seen on the circle, in units of the circle's pixels.
  Eigen::Vector2d on_circle(const Eigen::Vector2d& pixel, const Vector& p) const {
    return to_circle_ * (pixel - p.segment<2>(centre));
  }
  /// The pixel beside the ball, `margin_px` outside its streak, as seen from the centre towards
  /// another.
  Eigen::Vector2d beside(const Eigen::Vector2d& pixel, const Vector& p, double margin_px) const;

 private:
  Eigen::Matrix2d form_, to_circle_;
};

}  // namespace throwcal
