// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <Eigen/Core>

namespace throwcal {

/// What a shaded ball that moves during an exposure adds to a still background, pixel by pixel:
/// coverage x (shade - background).
///
/// Coverage follows the outline (a circle in coordinates that undo its form) along its streak.
/// Shade is that of a matt ball under a lamp (or the sun), an even sky and light from all around:
/// level + sky . n + max(0, sun . n) with n the surface's normal: x, y in the picture, h towards
/// the camera. So a lit side does not pull the centre; a sum without the maximum, whose kink is the
/// edge of the ball's own shadow, would be pulled by some hundredths of a pixel.
class BallModel {
 public:
  enum Parameter : int { centre = 0, streak = 2, radius = 4, level = 5, sky = 6, sun = 9 };
  static constexpr int size = 12;
  using Vector = Eigen::Matrix<double, size, 1>;

  /// `form`: symmetric, determinant 1: times a circle, the outline.
  explicit BallModel(const Eigen::Matrix2d& form) : form_(form), to_circle_(form.inverse()) {}

  /// Difference to the background [grey levels] at a pixel that shows `behind` without the ball,
  /// and its derivative by the parameters. The derivative by `level` is the coverage.
  double difference(const Eigen::Vector2d& pixel, double behind, const Vector& p,
                    Vector& derivative) const;

  /// In how many steps the streak is summed: what a pixel costs.
  static int sub_exposures(const Vector& p);

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
