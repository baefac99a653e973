// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "capture/background.h"
#include "capture/ball_model.h"
#include "capture/ball_outline.h"

namespace throwcal {

struct FittedBall {
  BallOutline outline;
  Eigen::Matrix2d cov_centre_px2;
  double explained = 0.0;  ///< share of the difference to the background that a ball explains, to 1
  double hidden =
      0.0;  ///< share of the ball's pixels that show something else; 0.09 by noise alone
  double foreign =
      0.0;  ///< share of its outline with something beside that moves or is not background
};

/// Fits a BallModel to the pixels around a blob by robust least squares. Keeps its memory.
class BallFit {
 public:
  BallFit();

  /// Pixels times steps of their streaks that were computed so far: the time it took, but the same
  /// on every machine.
  long work() const { return work_; }

  /// `form`: the outline's, see SphereOutline. `expected`: the ball as it should look by the frames
  /// before, whose size and streak hardly change; of its place nothing is believed. Nothing where
  /// the pixels show no ball.
  std::optional<FittedBall> fit(const cv::Mat& grey, const Background& background,
                                const Eigen::Matrix2d& form, const BallOutline& start,
                                const BallOutline* expected = nullptr);

 private:
  static constexpr int size = BallModel::size;
  using Vector = BallModel::Vector;
  using Matrix = Eigen::Matrix<double, size, size>;
  struct Pixel {
    Eigen::Vector2d at;
    double value, background, behind;
    double noise, unrest;  ///< of the picture; of what stands behind the ball
    double sigma;          ///< of the two, by whether the ball covers it
    double residual;       ///< in sigmas
    Vector derivative;
  };
  struct Solution {
    Vector p;
    Matrix information;
    double cost, scale, misfit;  ///< misfit: squared residuals a degree of freedom
  };

  void collect(const cv::Mat& grey, const Background& background, const BallOutline& start);
  Vector first_guess(const BallOutline& start);
  void expect(const BallOutline& ball);
  void evaluate(const BallModel& model, const Vector& p);
  double robust_scale();
  double cost(const Vector& p, double scale) const;
  Solution normal_equations(const Vector& p, double scale, Vector& gradient) const;
  std::optional<Solution> descend(const BallModel& model, const Vector& start, int max_steps);
  bool look_beside(const cv::Mat& grey, const Background& background, const BallModel& model,
                   const Vector& p);
  double explained(double scale) const;
  double hidden(double scale) const;
  double foreign() const;
  double correlation_factor(double camera_sigma_grey) const;
  std::optional<FittedBall> judged(const Solution& solution, double camera_sigma_grey) const;

  std::vector<Pixel> pixels_;
  std::vector<double> sizes_;
  long work_ = 0;
  Vector prior_, prior_weight_;  ///< mean and 1 / variance of what is known beforehand
};

}  // namespace throwcal
