// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "capture/background.h"
#include "capture/ball_model.h"

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

/// Fits a BallModel to the pixels around a blob by robust least squares. Keeps its memory.
class BallFit {
 public:
  /// `form`: the outline's, see SphereOutline. Nothing where the pixels show no ball.
  std::optional<FittedBall> fit(const cv::Mat& grey, const Background& background,
                                const Eigen::Matrix2d& form, const BallOutline& start);

 private:
  static constexpr int size = BallModel::size;
  using Vector = BallModel::Vector;
  using Matrix = Eigen::Matrix<double, size, size>;
  struct Pixel {
    Eigen::Vector2d at;
    double value, background, behind, sigma;
    double residual;  ///< in sigmas
    Vector derivative;
  };
  struct Solution {
    Vector p;
    Matrix information;
    double cost, scale, misfit;  ///< misfit: squared residuals a degree of freedom
  };

  void collect(const cv::Mat& grey, const Background& background, const BallOutline& start);
  Vector first_guess(const BallOutline& start);
  void evaluate(const BallModel& model, const Vector& p);
  double robust_scale();
  double cost(const Vector& p, double scale) const;
  Solution normal_equations(const Vector& p, double scale, Vector& gradient) const;
  std::optional<Solution> descend(const BallModel& model, const Vector& start, int max_steps);
  bool look_beside(const cv::Mat& grey, const Background& background, const BallModel& model,
                   const Vector& p);
  double explained(double scale) const;
  std::optional<FittedBall> judged(const Solution& solution) const;

  std::vector<Pixel> pixels_;
  std::vector<double> sizes_;
  Eigen::Matrix<double, 6, 1> light_prior_;  ///< 1 / variance of sky and sun
};

}  // namespace throwcal
