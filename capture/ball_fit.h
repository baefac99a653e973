// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "capture/background.h"

namespace throwcal {

/// A ball's outline as it moved through one exposure.
struct BallOutline {
  Eigen::Vector2d centre_px = Eigen::Vector2d::Zero();  ///< of the outline, at mid-exposure
  double radius_px = 0.0;                               ///< of the circle of the outline's area
  Eigen::Vector2d streak_px = Eigen::Vector2d::Zero();  ///< movement during the exposure
};

struct FittedBall {
  BallOutline outline;
  Eigen::Matrix2d cov_centre_px2;
  double explained = 0.0;  ///< share of the difference to the background that a ball explains, to 1
};

/// Fits a shaded, moving ball in front of a known background to the pixels around a blob, by robust
/// least squares: pixel = background + coverage x (shade - background). Coverage follows the
/// outline and its streak; shade is that of a lit sphere. So a lit side does not pull the centre,
/// nor does what stands behind.
class BallFit {
 public:
  /// `shape`: the outline's form, see SphereOutline. `region` must lie within the picture.
  std::optional<FittedBall> fit(const cv::Mat& grey, const Background& background,
                                const cv::Rect& region, const Eigen::Matrix2d& shape,
                                const BallOutline& start);

 private:
  static constexpr int size = 9;  ///< centre 2, streak 2, radius, shade 4
  using Vector = Eigen::Matrix<double, size, 1>;
  using Matrix = Eigen::Matrix<double, size, size>;
  struct Pixel {
    Eigen::Vector2d at;
    double difference, behind, sigma;
  };
  struct Normal {
    Matrix hessian;
    Vector gradient;
    double cost, squares, weights;
  };

  void collect(const cv::Mat& grey, const Background& background, const cv::Rect& region,
               double radius_px);
  double model(const Pixel& pixel, const Vector& p, Vector* derivative) const;
  Normal linearise(const Vector& p, double robust_scale) const;
  Vector first_guess(const BallOutline& start) const;
  double robust_scale(const Vector& p);

  std::vector<Pixel> pixels_;
  std::vector<double> residuals_;
  Eigen::Matrix2d to_circle_;  ///< inverse of the outline's form
  double shade_prior_ = 0.0;   ///< 1 / variance of the shade's slopes
  double pixel_area_px2_ = 1.0;
};

}  // namespace throwcal
