// SPDX-License-Identifier: BSD-3-Clause
#include "capture/simulated_picture.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "capture/dice.h"
#include "capture/sensor_noise.h"
#include "capture/simulated_background.h"

namespace throwcal {
namespace {

constexpr double vignette_depth = 0.3;
constexpr double ball_grey = 205.0, ambient = 0.6, skin_grey = 122.0, hand_grey = 134.0;
constexpr double arm_width_m = 0.075, hand_radius_m = 0.048, hand_below_ball_m = 0.055;
const Eigen::Vector3d shoulder_from_hand_m(0.18, 0.12, -0.75);
const Eigen::Vector3d light_world = Eigen::Vector3d(0.45, 0.3, 0.84).normalized();
constexpr int edge_samples = 5;  ///< a side, of a pixel that the outline crosses
constexpr int max_sub_exposures = 12;

/// Viewing rays (x/z, y/z) of a small region: the quadratic through nine exact ones. Within a
/// region of 100 pixels it is off by less than a hundredth of one.
class RayPatch {
 public:
  static std::optional<RayPatch> over(const CameraModel& model, const cv::Rect& region) {
    RayPatch patch;
    patch.middle_ = {region.x + 0.5 * (region.width - 1), region.y + 0.5 * (region.height - 1)};
    patch.half_ = {0.5 * region.width, 0.5 * region.height};
    for (int j = 0; j < 3; ++j)
      for (int i = 0; i < 3; ++i) {
        const auto ray = model.unproject(patch.middle_ +
                                         patch.half_.cwiseProduct(Eigen::Vector2d(i - 1, j - 1)));
        if (!ray || ray->z() < 1e-3) return std::nullopt;
        patch.node_[static_cast<std::size_t>(3 * j + i)] = ray->head<2>() / ray->z();
      }
    return patch;
  }
  Eigen::Vector3d at(double x, double y) const {
    const auto wx = weights((x - middle_.x()) / half_.x()),
               wy = weights((y - middle_.y()) / half_.y());
    Eigen::Vector2d sum(0, 0);
    for (std::size_t j = 0; j < 3; ++j)
      sum += wy[j] * (wx[0] * node_[3 * j] + wx[1] * node_[3 * j + 1] + wx[2] * node_[3 * j + 2]);
    return {sum.x(), sum.y(), 1.0};
  }

 private:
  static std::array<double, 3> weights(double t) {
    return {0.5 * t * (t - 1), 1 - t * t, 0.5 * t * (t + 1)};
  }
  Eigen::Vector2d middle_, half_;
  std::array<Eigen::Vector2d, 9> node_;
};

/// A lit sphere, in the camera's frame.
struct Sphere {
  Eigen::Vector3d centre_m, light;
  double radius_m;

  /// Grey level where a ray meets it; nothing where it passes by.
  std::optional<double> grey(const Eigen::Vector3d& ray) const {
    const double along = ray.dot(centre_m), ray2 = ray.squaredNorm();
    const double inside = along * along - ray2 * (centre_m.squaredNorm() - radius_m * radius_m);
    if (inside < 0) return std::nullopt;
    const Eigen::Vector3d hit = (along - std::sqrt(inside)) / ray2 * ray;
    const double facing = std::max(0.0, (hit - centre_m).dot(light) / radius_m);
    return ball_grey * (ambient + (1 - ambient) * facing);
  }
  /// Angle [rad] from the outline inwards to a ray, roughly: near the outline it counts only
  /// whether a pixel can be crossed by it.
  double inward_rad(const Eigen::Vector3d& ray) const {
    const double off = ray.cross(centre_m).norm() / (ray.norm() * centre_m.norm());
    return radius_m / centre_m.norm() - off;
  }
};

struct Exposed {
  double coverage = 0.0, light = 0.0;  ///< light: grey level times coverage
};

Exposed expose_pixel(const Sphere& ball, const RayPatch& rays, int x, int y, double pixel_rad) {
  const Eigen::Vector3d middle = rays.at(x, y);
  const double inward = ball.inward_rad(middle);
  if (inward < -0.8 * pixel_rad) return {};
  if (inward > 0.8 * pixel_rad) return {1.0, ball.grey(middle).value_or(0.0)};
  Exposed sum;
  constexpr double share = 1.0 / (edge_samples * edge_samples);
  for (int j = 0; j < edge_samples; ++j)
    for (int i = 0; i < edge_samples; ++i) {
      const double du = (i + 0.5) / edge_samples - 0.5, dv = (j + 0.5) / edge_samples - 0.5;
      const auto grey = ball.grey(rays.at(x + du, y + dv));
      if (grey) sum = {sum.coverage + share, sum.light + share * *grey};
    }
  return sum;
}

}  // namespace

SimulatedPicture::SimulatedPicture(std::shared_ptr<const SimulatedScene> scene, CameraId camera)
    : scene_(std::move(scene)),
      camera_(camera),
      model_(scene_->rig().cameras.at(camera).model),
      T_cam_world_(scene_->T_world_cam(camera).inverse()),
      light_cam_(T_cam_world_.rotation * light_world),
      arm_mask_(model_.height_px, model_.width_px, CV_8U, cv::Scalar(0)),
      noise_scale_(noise_scales()) {
  const cv::Mat picture = simulated_background(model_.width_px, model_.height_px,
                                               Dice(scene_->settings().seed, 1000, camera));
  still_.create(picture.size(), CV_16S);
  still_noise_.create(picture.size(), CV_8U);
  for (int y = 0; y < picture.rows; ++y)
    for (int x = 0; x < picture.cols; ++x) {
      const double grey = picture.at<float>(y, x) * vignette(x, y);
      still_.at<std::int16_t>(y, x) = static_cast<std::int16_t>(grey * grey_unit);
      still_noise_.at<std::uint8_t>(y, x) = noise_scale_[static_cast<std::size_t>(grey)];
    }
  canvas_ = still_.clone();
  canvas_noise_ = still_noise_.clone();
}

void SimulatedPicture::expose(double row0_mid_exposure_s, std::uint64_t number,
                              std::uint8_t* pixels) {
  paint_arm(time_of_ball_row(row0_mid_exposure_s));
  paint_ball(row0_mid_exposure_s);
  const std::uint64_t seed = scene_->settings().seed * 64 + camera_;
  add_sensor_noise(canvas_, canvas_noise_, Dice(seed, 2000, number), pixels);
  forget_what_moved();
}

double SimulatedPicture::vignette(double x, double y) const {
  const double u = x - model_.cx_px, v = y - model_.cy_px;
  const double corner2 =
      0.25 * (model_.width_px * model_.width_px + model_.height_px * model_.height_px);
  return 1 - vignette_depth * (u * u + v * v) / corner2;
}

cv::Rect SimulatedPicture::touch(cv::Rect region) {
  region &= cv::Rect(0, 0, model_.width_px, model_.height_px);
  if (!region.empty()) touched_.push_back(region);
  return region;
}

void SimulatedPicture::forget_what_moved() {
  for (const cv::Rect& region : touched_) {
    still_(region).copyTo(canvas_(region));
    still_noise_(region).copyTo(canvas_noise_(region));
  }
  touched_.clear();
}

void SimulatedPicture::blend(int x, int y, double coverage, double grey) {
  auto& pixel = canvas_.at<std::int16_t>(y, x);
  const double mixed = pixel + coverage * (grey * vignette(x, y) * grey_unit - pixel);
  pixel = static_cast<std::int16_t>(std::clamp(mixed + 0.5, 0.0, 255.0 * grey_unit));
  canvas_noise_.at<std::uint8_t>(y, x) = noise_scale_[static_cast<std::size_t>(pixel / grey_unit)];
}

/// A rolling shutter exposes the ball when it reads the ball's rows.
double SimulatedPicture::time_of_ball_row(double row0_s) const {
  if (model_.row_time_s == 0.0) return row0_s;
  double time_s = row0_s + 0.5 * model_.height_px * model_.row_time_s;
  for (int i = 0; i < 6; ++i) {
    const auto ball = scene_->ball_at(time_s);
    if (!ball) break;
    const auto pixel = model_.project(T_cam_world_ * ball->position_world_m);
    if (!pixel || !model_.contains(*pixel, -100)) break;
    time_s = row0_s + model_.row_time_s * pixel->y();
  }
  return time_s;
}

/// A thick line from the hand to a shoulder below and behind it.
void SimulatedPicture::paint_arm(double time_s) {
  const auto at = scene_->hand_at(time_s);
  if (!at) return;
  const Eigen::Vector3d hand = T_cam_world_ * (*at - Eigen::Vector3d(0, 0, hand_below_ball_m));
  const Eigen::Vector3d shoulder = T_cam_world_ * (*at + shoulder_from_hand_m);
  if (hand.z() < 0.3 || shoulder.z() < 0.3) return;
  const auto tip = model_.project(hand), end = model_.project(shoulder);
  if (!tip || !end) return;
  const auto sixteenths = [](const Eigen::Vector2d& p) {
    return cv::Point(cvRound(16 * p.x()), cvRound(16 * p.y()));
  };
  const int width = std::max(2, cvRound(arm_width_m * model_.fx_px / shoulder.z()));
  const double radius = hand_radius_m * model_.fx_px / hand.z();
  const int margin = static_cast<int>(std::max<double>(width, radius)) + 3;
  const cv::Point low(static_cast<int>(std::min(tip->x(), end->x())),
                      static_cast<int>(std::min(tip->y(), end->y())));
  const cv::Point high(static_cast<int>(std::max(tip->x(), end->x())),
                       static_cast<int>(std::max(tip->y(), end->y())));
  const cv::Rect region =
      touch({low - cv::Point(margin, margin), high + cv::Point(margin, margin)});
  if (region.empty()) return;
  const auto lay_on = [&](double grey) {
    for (int y = region.y; y < region.br().y; ++y)
      for (int x = region.x; x < region.br().x; ++x)
        if (const int covered = arm_mask_.at<std::uint8_t>(y, x))
          blend(x, y, covered / 255.0, grey);
    arm_mask_(region) = 0;
  };
  cv::line(arm_mask_, sixteenths(*tip), sixteenths(*end), 255, width, cv::LINE_AA, 4);
  lay_on(skin_grey);
  cv::circle(arm_mask_, sixteenths(*tip), cvRound(16 * radius), 255, cv::FILLED, cv::LINE_AA, 4);
  lay_on(hand_grey);
}

void SimulatedPicture::paint_ball(double row0_mid_exposure_s) {
  const double middle_s = time_of_ball_row(row0_mid_exposure_s);
  const double half_s = 0.5 * scene_->settings().exposure_s;
  const auto middle = scene_->ball_at(middle_s);
  if (!middle) return;
  // Within an exposure the path is straight: gravity bends it by micrometres.
  const auto first = scene_->ball_at(middle_s - half_s), last = scene_->ball_at(middle_s + half_s);
  const Eigen::Vector3d a = T_cam_world_ * (first ? *first : *middle).position_world_m;
  const Eigen::Vector3d b = T_cam_world_ * (last ? *last : *middle).position_world_m;
  const double radius_m = 0.5 * scene_->rig().ball.diameter_m, near_m = std::min(a.z(), b.z());
  if (near_m < 4 * radius_m) return;
  const auto from = model_.project(a), to = model_.project(b);
  if (!from || !to || !model_.contains(*from, -100) || !model_.contains(*to, -100)) return;

  const double reach_px = 1.4 * model_.fx_px * radius_m / near_m + 2;
  const Eigen::Vector2d low = from->cwiseMin(*to).array() - reach_px,
                        high = from->cwiseMax(*to).array() + reach_px;
  const cv::Rect region = touch({cv::Point(cvFloor(low.x()), cvFloor(low.y())),
                                 cv::Point(cvCeil(high.x()) + 1, cvCeil(high.y()) + 1)});
  if (region.empty()) return;
  const auto rays = RayPatch::over(model_, region);
  if (!rays) return;
  const int sub_exposures =
      std::clamp(cvCeil((*to - *from).norm() / 0.7) + 2, 3, max_sub_exposures);
  std::array<Sphere, max_sub_exposures> balls;
  for (int i = 0; i < sub_exposures; ++i)
    balls[static_cast<std::size_t>(i)] = {a + (i + 0.5) / sub_exposures * (b - a), light_cam_,
                                          radius_m};
  const double pixel_rad = 1.0 / std::min(model_.fx_px, model_.fy_px);
  for (int y = region.y; y < region.br().y; ++y)
    for (int x = region.x; x < region.br().x; ++x) {
      Exposed sum;
      for (int i = 0; i < sub_exposures; ++i) {
        const Exposed one =
            expose_pixel(balls[static_cast<std::size_t>(i)], *rays, x, y, pixel_rad);
        sum = {sum.coverage + one.coverage, sum.light + one.light};
      }
      if (sum.coverage > 0) blend(x, y, sum.coverage / sub_exposures, sum.light / sum.coverage);
    }
}

}  // namespace throwcal
