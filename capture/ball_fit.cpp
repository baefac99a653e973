// SPDX-License-Identifier: BSD-3-Clause
#include "capture/ball_fit.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace throwcal {
namespace {

constexpr int max_steps = 12;
constexpr double still_px = 0.4;         ///< shorter streaks cannot be told from none
constexpr double sub_exposure_px = 1.0;  ///< a streak is summed in steps of this
constexpr int max_sub_exposures = 16;
constexpr double dense_radius_px = 14.0;  ///< of larger balls every second, third ... pixel will do
constexpr double converged_px = 0.002;
constexpr double robust_sigmas = 3.0;
constexpr double shade_slope = 0.7;  ///< 1-sigma of a shade's slope, relative to its contrast
constexpr double min_limb = 0.15;    ///< keeps the sphere's slope finite at its limb
constexpr double min_radius_px = 0.8;

enum Parameter : int { centre = 0, streak = 2, radius = 4, level = 5, slope = 6, bulge = 8 };

int sub_exposures(const Eigen::Vector2d& streak_px) {
  const double length = streak_px.norm();
  if (length == 0.0) return 1;
  return std::clamp(static_cast<int>(std::ceil(length / sub_exposure_px)) + 1, 2,
                    max_sub_exposures);
}

}  // namespace

/// Difference to the background that a pixel should show, and its derivative by the parameters.
double BallFit::model(const Pixel& pixel, const Vector& p, Vector* derivative) const {
  const Eigen::Vector2d moved = p.segment<2>(streak);
  const int n = sub_exposures(moved);
  const double r = p[radius], share = 1.0 / n;
  double sum = 0;
  if (derivative) derivative->setZero();
  for (int i = 0; i < n; ++i) {
    const double phase = (i + 0.5) * share - 0.5;
    const Eigen::Vector2d off = to_circle_ * (pixel.at - p.segment<2>(centre) - phase * moved);
    const double distance = off.norm(), coverage = std::clamp(0.5 + r - distance, 0.0, 1.0);
    if (coverage == 0.0) continue;
    const double x = off.x() / r, y = off.y() / r;
    const double height = std::sqrt(std::max(min_limb * min_limb, 1 - x * x - y * y));
    const double contrast =
        p[level] + p[slope] * x + p[slope + 1] * y + p[bulge] * height - pixel.behind;
    sum += share * coverage * contrast;
    if (!derivative) continue;
    Vector& d = *derivative;
    const double weight = share * coverage;
    d[level] += weight;
    d[slope] += weight * x;
    d[slope + 1] += weight * y;
    d[bulge] += weight * height;
    Eigen::Vector2d by_off = weight / r * p.segment<2>(slope);
    double by_radius = -weight / r * (p[slope] * x + p[slope + 1] * y);
    if (height > min_limb) {
      by_off -= weight * p[bulge] / (r * height) * Eigen::Vector2d(x, y);
      by_radius += weight * p[bulge] * (x * x + y * y) / (r * height);
    }
    if (coverage < 1.0) {
      by_off -= share * contrast / distance * off;
      by_radius += share * contrast;
    }
    const Eigen::Vector2d by_centre = -to_circle_.transpose() * by_off;
    d.segment<2>(centre) += by_centre;
    d.segment<2>(streak) += phase * by_centre;
    d[radius] += by_radius;
  }
  return sum;
}

void BallFit::collect(const cv::Mat& grey, const Background& background, const cv::Rect& region,
                      double radius_px) {
  const int stride = std::max(1, static_cast<int>(radius_px / dense_radius_px) + 1);
  pixel_area_px2_ = stride * stride;
  pixels_.clear();
  for (int y = region.y; y < region.br().y; y += stride)
    for (int x = region.x; x < region.br().x; x += stride) {
      const double behind = background.grey(x, y);
      pixels_.push_back(
          {{x, y}, grey.at<std::uint8_t>(y, x) - behind, behind, background.sigma_grey(x, y)});
    }
}

BallFit::Vector BallFit::first_guess(const BallOutline& start) const {
  Vector p = Vector::Zero();
  p.segment<2>(centre) = start.centre_px;
  p[radius] = start.radius_px;
  double sum = 0, count = 0;
  for (const Pixel& pixel : pixels_)
    if ((to_circle_ * (pixel.at - start.centre_px)).norm() < 0.6 * start.radius_px + 0.5) {
      sum += pixel.difference + pixel.behind;
      ++count;
    }
  if (count > 0) p[level] = sum / count;
  if (start.streak_px.norm() > still_px) p.segment<2>(streak) = start.streak_px;
  return p;
}

/// Three times the residuals' typical size, or the noise if that is larger: what is beyond does not
/// belong to the ball (a hand, an edge that moved).
double BallFit::robust_scale(const Vector& p) {
  residuals_.clear();
  for (const Pixel& pixel : pixels_)
    residuals_.push_back(std::abs(pixel.difference - model(pixel, p, nullptr)) / pixel.sigma);
  const auto middle = residuals_.begin() + static_cast<std::ptrdiff_t>(residuals_.size() / 2);
  std::nth_element(residuals_.begin(), middle, residuals_.end());
  return robust_sigmas * std::max(1.0, 1.4826 * *middle);
}

BallFit::Normal BallFit::linearise(const Vector& p, double scale) const {
  Normal normal{Matrix::Zero(), Vector::Zero(), 0, 0, 0};
  Vector derivative;
  for (const Pixel& pixel : pixels_) {
    const double residual = (pixel.difference - model(pixel, p, &derivative)) / pixel.sigma;
    const double outlying = residual * residual / (scale * scale), weight = 1 / (1 + outlying);
    normal.cost += 0.5 * scale * scale * std::log1p(outlying);
    normal.squares += weight * residual * residual;
    normal.weights += weight;
    if (derivative.isZero(0.0)) continue;
    derivative /= pixel.sigma;
    normal.hessian.selfadjointView<Eigen::Lower>().rankUpdate(derivative, weight);
    normal.gradient += weight * residual * derivative;
  }
  for (int i = slope; i <= bulge; ++i) {
    normal.hessian(i, i) += shade_prior_;
    normal.gradient[i] -= shade_prior_ * p[i];
    normal.cost += 0.5 * shade_prior_ * p[i] * p[i];
  }
  if (p.segment<2>(streak).isZero(0.0)) {
    normal.hessian(streak, streak) += 1.0;
    normal.hessian(streak + 1, streak + 1) += 1.0;
  }
  normal.hessian.triangularView<Eigen::StrictlyUpper>() = normal.hessian.transpose();
  return normal;
}

std::optional<FittedBall> BallFit::fit(const cv::Mat& grey, const Background& background,
                                       const cv::Rect& region, const Eigen::Matrix2d& shape,
                                       const BallOutline& start) {
  to_circle_ = shape.inverse();
  collect(grey, background, region, start.radius_px);
  Vector p = first_guess(start);
  const double contrast = p[level] - background.grey(static_cast<int>(start.centre_px.x()),
                                                     static_cast<int>(start.centre_px.y()));
  shade_prior_ = 1.0 / std::max(1.0, std::pow(shade_slope * contrast, 2));

  double damping = 1e-3, scale = robust_scale(p);
  Normal now = linearise(p, scale);
  for (int i = 0; i < max_steps; ++i) {
    Matrix damped = now.hessian;
    damped.diagonal() *= 1 + damping;
    const Vector step = damped.ldlt().solve(now.gradient);
    const Vector tried = p + step;
    if (!tried.allFinite()) return std::nullopt;
    const bool is_possible = tried[radius] > min_radius_px &&
                             tried[radius] < 2 * start.radius_px + 2 &&
                             (tried.head<2>() - start.centre_px).norm() < start.radius_px + 2;
    Normal next;
    if (is_possible) next = linearise(tried, scale);
    if (!is_possible || next.cost > now.cost) {
      damping *= 10;
      if (damping > 1e6) break;
      continue;
    }
    p = tried;
    damping *= 0.2;
    const double new_scale = robust_scale(p);
    const bool is_settled = step.head<2>().norm() < converged_px && new_scale > 0.95 * scale;
    if (new_scale < scale) {
      scale = new_scale;
      now = linearise(p, scale);
    } else {
      now = next;
    }
    if (is_settled) break;
  }

  double left = 0, whole = 1e-9;
  for (const Pixel& pixel : pixels_) {
    left += std::pow(pixel.difference - model(pixel, p, nullptr), 2);
    whole += std::pow(pixel.difference, 2);
  }
  const Eigen::LDLT<Matrix> factors(now.hessian);
  if (factors.info() != Eigen::Success || now.weights < size + 2) return std::nullopt;
  const double variance = std::max(1.0, now.squares / (now.weights - size));
  const Matrix cov = factors.solve(Matrix::Identity());
  FittedBall ball{{p.segment<2>(centre), p[radius], p.segment<2>(streak)},
                  variance * cov.topLeftCorner<2, 2>(),
                  1 - left / whole};
  if (!ball.cov_centre_px2.allFinite() || !(ball.cov_centre_px2.determinant() > 0))
    return std::nullopt;
  return ball;
}

}  // namespace throwcal
