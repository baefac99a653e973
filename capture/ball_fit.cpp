// SPDX-License-Identifier: BSD-3-Clause
#include "capture/ball_fit.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace throwcal {
namespace {

constexpr int first_steps = 10, further_steps = 5;
constexpr int looks_beside = 2;
constexpr double still_px = 0.4;  ///< shorter streaks cannot be told from none
constexpr double max_side_samples =
    32.0;                          ///< of larger balls every second, third ... pixel will do
constexpr double margin_px = 3.0;  ///< of background around the ball
constexpr double beside_px = 1.5;
constexpr double settled_gain = 2e-3;  ///< of the cost: moves the ball by 1/16 of its sigma
constexpr double robust_sigmas = 3.0;
constexpr double foreign_sigmas = 5.0;  ///< beside the ball, this is not the background
/// 1-sigma of the light from sky and sun, relative to the ball's contrast.
constexpr double sky_spread = 0.5, sun_spread = 1.5;
constexpr double min_radius_px = 0.8;
/// By how much size and streak may differ from the frame before: share and pixels, 1-sigma.
constexpr double sigma_size = 0.03, sigma_size_px = 0.05;
constexpr double limb_px = 0.7;  ///< within the outline by so much, nothing behind shines through
constexpr double beside_unrest = 0.5;       ///< of the unrest that is left where it was looked up
constexpr double camera_sigmas = 2.0;       ///< of the typical noise: what is more is no noise
constexpr double correlated_pixels = 12.0;  ///< of a leaf, or of an edge that moves
constexpr double restless = 2.0;            ///< times the noise: what is behind moves
constexpr double poor_misfit = 3.0;
constexpr int hopeless_steps = 3;
constexpr double hopeless_explained = 0.6;

using P = BallModel;

double cauchy_weight(double residual, double scale) {
  return 1 / (1 + residual * residual / (scale * scale));
}

}  // namespace

BallFit::BallFit() {
  pixels_.reserve(4096);
  sizes_.reserve(4096);
}

void BallFit::collect(const cv::Mat& grey, const Background& background, const BallOutline& start) {
  const double reach = 1.2 * start.radius_px + 0.5 * start.streak_px.norm() + margin_px;
  const int stride = std::max(1, cvCeil(2 * reach / max_side_samples));
  const cv::Rect region =
      cv::Rect(
          cv::Point(cvFloor(start.centre_px.x() - reach), cvFloor(start.centre_px.y() - reach)),
          cv::Point(cvCeil(start.centre_px.x() + reach), cvCeil(start.centre_px.y() + reach))) &
      cv::Rect({}, grey.size());
  const double most_noise = camera_sigmas * background.typical_sigma_grey();
  pixels_.clear();
  for (int y = region.y; y < region.br().y; y += stride)
    for (int x = region.x; x < region.br().x; x += stride) {
      const Eigen::Vector2d at(x, y);
      if ((at - start.centre_px).norm() > reach) continue;
      const double still = background.grey(x, y);
      const double all = background.sigma_grey(x, y), noise = std::min(all, most_noise);
      const double unrest =
          std::hypot(background.unrest_grey(x, y), std::sqrt(all * all - noise * noise));
      const bool is_covered = (at - start.centre_px).norm() < start.radius_px - limb_px;
      pixels_.push_back({at, static_cast<double>(grey.at<std::uint8_t>(y, x)), still, still, noise,
                         unrest, is_covered ? noise : std::hypot(noise, unrest), 0.0,
                         Vector::Zero()});
    }
}

BallFit::Vector BallFit::first_guess(const BallOutline& start) {
  double sum = 0, contrast = 0, count = 0;
  for (const Pixel& pixel : pixels_)
    if ((pixel.at - start.centre_px).norm() < 0.6 * start.radius_px + 0.5) {
      sum += pixel.value;
      contrast += std::abs(pixel.value - pixel.background);
      ++count;
    }
  Vector p = Vector::Zero();
  p.segment<2>(P::centre) = start.centre_px;
  if (start.streak_px.norm() > still_px) p.segment<2>(P::streak) = start.streak_px;
  p[P::radius] = start.radius_px;
  p[P::level] = sum / std::max(1.0, count);
  const double scale2 = std::max(1.0, std::pow(contrast / std::max(1.0, count), 2));
  prior_.setZero();
  prior_weight_.setZero();
  prior_weight_.segment<3>(P::sky).setConstant(1 / (sky_spread * sky_spread * scale2));
  prior_weight_.segment<3>(P::sun).setConstant(1 / (sun_spread * sun_spread * scale2));
  return p;
}

void BallFit::expect(const BallOutline& ball) {
  const double sigma_radius = sigma_size_px + sigma_size * ball.radius_px;
  const double sigma_streak = sigma_size_px + 3 * sigma_size * ball.streak_px.norm();
  prior_[P::radius] = ball.radius_px;
  prior_weight_[P::radius] = 1 / (sigma_radius * sigma_radius);
  prior_.segment<2>(P::streak) = ball.streak_px;
  prior_weight_.segment<2>(P::streak).setConstant(1 / (sigma_streak * sigma_streak));
}

void BallFit::evaluate(const BallModel& model, const Vector& p) {
  work_ += std::ssize(pixels_) * BallModel::sub_exposures(p);
  for (Pixel& pixel : pixels_) {
    const double modelled = model.difference(pixel.at, pixel.behind, p, pixel.derivative);
    pixel.residual = (pixel.value - pixel.behind - modelled) / pixel.sigma;
    pixel.derivative /= pixel.sigma;
  }
}

/// Three times the residuals' typical size, or the noise if that is larger: what is beyond does not
/// belong to the ball (a hand, an edge that moved).
double BallFit::robust_scale() {
  sizes_.clear();
  for (const Pixel& pixel : pixels_) sizes_.push_back(std::abs(pixel.residual));
  const auto middle = sizes_.begin() + static_cast<std::ptrdiff_t>(sizes_.size() / 2);
  std::nth_element(sizes_.begin(), middle, sizes_.end());
  return robust_sigmas * std::max(1.0, 1.4826 * *middle);
}

/// Cauchy's cost. The logarithm of a product is the sum of logarithms, at the price of one.
double BallFit::cost(const Vector& p, double scale) const {
  const double per_scale2 = 1 / (scale * scale);
  double sum = 0, product = 1;
  for (const Pixel& pixel : pixels_) {
    product *= 1 + pixel.residual * pixel.residual * per_scale2;
    if (product < 1e200) continue;
    sum += std::log(product);
    product = 1;
  }
  return 0.5 * prior_weight_.dot((p - prior_).cwiseAbs2()) +
         0.5 * scale * scale * (sum + std::log(product));
}

BallFit::Solution BallFit::normal_equations(const Vector& p, double scale, Vector& gradient) const {
  Solution out{p, Matrix::Zero(), cost(p, scale), scale, 0};
  gradient.setZero();
  double squares = 0, weights = 0;
  for (const Pixel& pixel : pixels_) {
    const double weight = cauchy_weight(pixel.residual, scale);
    squares += weight * pixel.residual * pixel.residual;
    weights += weight;
    if (pixel.derivative[P::level] == 0.0) continue;
    out.information.selfadjointView<Eigen::Lower>().rankUpdate(pixel.derivative, weight);
    gradient += weight * pixel.residual * pixel.derivative;
  }
  out.misfit = squares / std::max(1.0, weights - size);
  out.information.diagonal() += prior_weight_;
  gradient -= prior_weight_.cwiseProduct(p - prior_);
  if (p.segment<2>(P::streak).isZero(0.0)) {  // stays what it is: its derivative is zero there
    out.information.diagonal().segment<2>(P::streak).array() += 1.0;
    gradient.segment<2>(P::streak).setZero();
  }
  out.information.triangularView<Eigen::StrictlyUpper>() = out.information.transpose();
  return out;
}

std::optional<BallFit::Solution> BallFit::descend(const BallModel& model, const Vector& start,
                                                  int max_steps) {
  Vector gradient;
  evaluate(model, start);
  Solution now = normal_equations(start, robust_scale(), gradient);
  double damping = 1e-3;
  for (int i = 0; i < max_steps && damping < 1e4; ++i) {
    Matrix damped = now.information;
    damped.diagonal() *= 1 + damping;
    const Vector step = damped.ldlt().solve(gradient), tried = now.p + step;
    if (!tried.allFinite()) return std::nullopt;
    const double strayed = (tried - start).segment<2>(P::centre).norm();
    const bool is_possible = tried[P::radius] > min_radius_px &&
                             tried[P::radius] < 2 * start[P::radius] + 2 &&
                             strayed < start[P::radius] + 2;
    if (is_possible) evaluate(model, tried);
    const double gain = is_possible ? now.cost - cost(tried, now.scale) : -1.0;
    if (gain < 0) {
      damping *= 10;
      continue;
    }
    damping *= 0.2;
    const double scale = std::min(now.scale, robust_scale());
    const bool is_settled = gain < settled_gain * now.misfit && scale > 0.9 * now.scale;
    now = normal_equations(tried, scale, gradient);
    if (is_settled) break;
    if (i == hopeless_steps && explained(scale) < hopeless_explained) return std::nullopt;
  }
  return now;
}

/// What stands behind a ball need not be the background: the hand that threw it, say. It can be
/// seen beside the ball. True if that differs from what was thought.
bool BallFit::look_beside(const cv::Mat& grey, const Background& background, const BallModel& model,
                          const Vector& p) {
  const double most_grey = camera_sigmas * background.typical_sigma_grey();
  const auto is_foreign = [&](double value, int x, int y) {
    return std::abs(value - background.grey(x, y)) >
           foreign_sigmas * std::min(background.sigma_grey(x, y), most_grey);
  };
  evaluate(model, p);
  bool is_new = false;
  for (Pixel& pixel : pixels_) {
    const bool is_covered = pixel.derivative[P::level] > 0.0;
    const Eigen::Vector2d look = is_covered ? model.beside(pixel.at, p, beside_px) : pixel.at;
    const int x = cvRound(look.x()), y = cvRound(look.y());
    double behind = pixel.background;
    if (x >= 0 && y >= 0 && x < grey.cols && y < grey.rows) {
      const double value = grey.at<std::uint8_t>(y, x);
      if (is_foreign(value, x, y)) behind = value;
    }
    // What stands beside tells what is behind, if not for sure.
    if (behind != pixel.background && pixel.sigma > pixel.noise)
      pixel.sigma = std::hypot(pixel.noise, beside_unrest * pixel.unrest);
    is_new |= is_covered && std::abs(behind - pixel.behind) > foreign_sigmas * pixel.sigma;
    pixel.behind = behind;
  }
  return is_new;
}

/// Of the pixels as last evaluated.
double BallFit::explained(double scale) const {
  double left = 0, whole = 1e-9;
  for (const Pixel& pixel : pixels_) {
    const double weight = cauchy_weight(pixel.residual, scale);
    left += weight * std::pow(pixel.residual * pixel.sigma, 2);
    whole += weight * std::pow(pixel.value - pixel.behind, 2);
  }
  return 1 - left / whole;
}

/// Of the pixels as last evaluated.
double BallFit::hidden(double scale) const {
  double hidden = 0, whole = 1e-9;
  for (const Pixel& pixel : pixels_) {
    const double coverage = pixel.derivative[P::level] * pixel.sigma;
    whole += coverage;
    hidden += coverage * (1 - cauchy_weight(pixel.residual, scale));
  }
  return hidden / whole;
}

double BallFit::foreign() const {
  double foreign = 0, whole = 1e-9;
  for (const Pixel& pixel : pixels_) {
    const double coverage = pixel.derivative[P::level] * pixel.sigma;
    const double rim = coverage * (1 - coverage);
    whole += rim;
    if (pixel.behind != pixel.background || pixel.unrest > restless * pixel.noise) foreign += rim;
  }
  return foreign / whole;
}

/// Noise of a camera is white, but what sways behind a ball moves whole groups of pixels at once.
/// By how much the variance of a centre is larger for that, as far as the rim's sigma is beyond
/// the camera's.
double BallFit::correlation_factor(double camera_sigma_grey) const {
  double sum = 0, whole = 1e-9;
  for (const Pixel& pixel : pixels_) {
    const double coverage = pixel.derivative[P::level] * pixel.sigma;
    const double rim = coverage * (1 - coverage);
    whole += rim;
    sum += rim * std::pow(std::min(1.0, camera_sigmas * camera_sigma_grey /
                                            std::hypot(pixel.noise, pixel.unrest)),
                          2);
  }
  return 1 + correlated_pixels * (1 - sum / whole);
}

std::optional<FittedBall> BallFit::judged(const Solution& solution,
                                          double camera_sigma_grey) const {
  const Eigen::LDLT<Matrix> factors(solution.information);
  if (factors.info() != Eigen::Success) return std::nullopt;
  const Matrix cov = std::max(1.0, solution.misfit) * factors.solve(Matrix::Identity());
  const Vector& p = solution.p;
  FittedBall ball{{p.segment<2>(P::centre), p[P::radius], p.segment<2>(P::streak)},
                  correlation_factor(camera_sigma_grey) * cov.topLeftCorner<2, 2>(),
                  explained(solution.scale),
                  hidden(solution.scale),
                  foreign()};
  const bool is_sound = ball.cov_centre_px2.allFinite() && ball.cov_centre_px2.determinant() > 0;
  return is_sound ? std::optional(ball) : std::nullopt;
}

std::optional<FittedBall> BallFit::fit(const cv::Mat& grey, const Background& background,
                                       const Eigen::Matrix2d& form, const BallOutline& start,
                                       const BallOutline* expected) {
  const BallModel model(form);
  collect(grey, background, start);
  if (pixels_.size() < size + 2) return std::nullopt;
  Vector guess = first_guess(start);
  if (expected) expect(*expected);
  auto best = descend(model, guess, first_steps);
  if (!best) return std::nullopt;
  for (int i = 0; i < looks_beside && look_beside(grey, background, model, best->p); ++i) {
    best = descend(model, best->p, further_steps);
    if (!best) return std::nullopt;
  }
  if (best->misfit > poor_misfit && !guess.segment<2>(P::streak).isZero(0.0)) {
    guess.segment<2>(P::streak).setZero();  // a ball at rest before something as bright as it is
    const auto other = descend(model, guess, first_steps);
    if (other && other->misfit < best->misfit) best = other;
  }
  evaluate(model, best->p);
  return judged(*best, background.typical_sigma_grey());
}

}  // namespace throwcal
