// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/picture.h"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <vector>

#include "estimator/ballistics.h"

namespace throwcal {
namespace {

constexpr double width_px = 960, margin_px = 70;
constexpr double azimuth_rad = -1.05,
                 elevation_rad = 0.5;  // of the viewer, seen from the middle of the rig
constexpr double pyramid_m = 0.45;     // depth of the pyramid that stands for a camera
constexpr double flight_step_s = 0.02, longest_flight_s = 20.0;
/// What is farther from the origin is left out: a solution that is not determined may be anywhere.
constexpr double horizon_m = 1000.0;
constexpr std::array colours{"#d1495b", "#edae49", "#3a7d44", "#30638e",
                             "#7b4b94", "#00798c", "#c05746", "#6a8e23"};

using Points = std::vector<Eigen::Vector3d>;

template <typename... Values>
std::string text(const char* format, Values... values) {
  char buffer[512];
  std::snprintf(buffer, sizeof buffer, format, values...);
  return buffer;
}

std::string escaped(const std::string& raw) {
  std::string out;
  for (char c : raw)
    out += c == '<' ? "&lt;" : c == '&' ? "&amp;" : c == '>' ? "&gt;" : std::string(1, c);
  return out;
}

bool is_near(const Eigen::Vector3d& p) {
  return p.allFinite() && p.cwiseAbs().maxCoeff() < horizon_m;
}

Points flight_points(const ThrowEstimate& thrown, const Calibration& c) {
  Points out;
  const double duration_s = std::min(seconds(thrown.end - thrown.start), longest_flight_s);
  for (double t = 0; t < duration_s + flight_step_s; t += flight_step_s) {
    const BallState ball = fly({thrown.position_world_m, thrown.velocity_world_mps},
                               std::min(t, duration_s), {0, 0, -c.gravity_mps2}, c.drag_per_m);
    if (!is_near(ball.position_m)) break;
    out.push_back(ball.position_m);
  }
  return out;
}

bool is_drawn(const CameraCalibration& camera) {
  return camera.T_world_cam && is_near(camera.T_world_cam->translation);
}

/// Apex at the camera's centre, then the four corners of what it sees (a nominal 60 by 45 degrees).
Points pyramid_points(const Rigid& T_world_cam) {
  Points out{T_world_cam.translation};
  for (const auto& [x, y] : {std::pair{-1.0, -1.0}, {1.0, -1.0}, {1.0, 1.0}, {-1.0, 1.0}})
    out.push_back(T_world_cam * (pyramid_m * Eigen::Vector3d(0.577 * x, 0.414 * y, 1.0)));
  return out;
}

/// The paper: world metres to picture pixels, and the strokes so far.
class Drawing {
 public:
  explicit Drawing(const Points& everything) {
    Eigen::Vector2d low = flat(everything.front()), high = low;
    for (const Eigen::Vector3d& p : everything)
      low = low.cwiseMin(flat(p)), high = high.cwiseMax(flat(p));
    scale_ = (width_px - 2 * margin_px) / std::max(high.x() - low.x(), 1.0);
    shift_ = Eigen::Vector2d(margin_px, margin_px) - scale_ * low;
    height_px_ = 2 * margin_px + scale_ * (high.y() - low.y());
  }
  void line(const Points& points, const std::string& style) {
    body_ += "<polyline points=\"";
    for (const Eigen::Vector3d& p : points) body_ += text("%.1f,%.1f ", at(p).x(), at(p).y());
    body_ +=
        "\" fill=\"none\" stroke-linejoin=\"round\" stroke-linecap=\"round\" " + style + "/>\n";
  }
  void dot(const Eigen::Vector3d& p, double radius_px, const std::string& style) {
    body_ += text("<circle cx=\"%.1f\" cy=\"%.1f\" r=\"%.1f\" ", at(p).x(), at(p).y(), radius_px) +
             style + "/>\n";
  }
  void label(const Eigen::Vector3d& p, double down_px, const std::string& words,
             const std::string& style) {
    body_ += text("<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"middle\" ", at(p).x(),
                  at(p).y() + down_px) +
             style + ">" + escaped(words) + "</text>\n";
  }
  std::string svg() const {
    return text(
               "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 %.0f %.0f\" "
               "font-family=\"sans-serif\" font-size=\"15\">\n"
               "<rect width=\"100%%\" height=\"100%%\" fill=\"#fbfaf7\"/>\n",
               width_px, height_px_) +
           body_ + "</svg>\n";
  }

 private:
  static Eigen::Vector2d flat(const Eigen::Vector3d& p) {
    const double s = std::sin(azimuth_rad), c = std::cos(azimuth_rad);
    const double right = -s * p.x() + c * p.y(), away = c * p.x() + s * p.y();
    return {right, away * std::sin(elevation_rad) - p.z() * std::cos(elevation_rad)};
  }
  Eigen::Vector2d at(const Eigen::Vector3d& p) const { return scale_ * flat(p) + shift_; }

  double scale_ = 1.0, height_px_ = 0.0;
  Eigen::Vector2d shift_ = Eigen::Vector2d::Zero();
  std::string body_;
};

void draw_ground(Drawing& drawing, const Eigen::Vector3d& low, const Eigen::Vector3d& high) {
  const std::string style = "stroke=\"#d8d4ca\" stroke-width=\"1\"";
  for (double x = low.x(); x <= high.x() + 1e-9; ++x)
    drawing.line({{x, low.y(), low.z()}, {x, high.y(), low.z()}}, style);
  for (double y = low.y(); y <= high.y() + 1e-9; ++y)
    drawing.line({{low.x(), y, low.z()}, {high.x(), y, low.z()}}, style);
}

void draw_camera(Drawing& drawing, const CameraCalibration& camera, double ground_m) {
  const Points p = pyramid_points(*camera.T_world_cam);
  const std::string dark = "stroke=\"#33312c\" stroke-width=\"1.6\"";
  drawing.line({p[0], {p[0].x(), p[0].y(), ground_m}}, "stroke=\"#b9b4a7\" stroke-width=\"3\"");
  drawing.line({p[1], p[2], p[3], p[4], p[1], p[0], p[2]}, dark);
  drawing.line({p[3], p[0], p[4]}, dark);
  drawing.dot(p[0], 4.5, "fill=\"#33312c\"");
  drawing.label({p[0].x(), p[0].y(), ground_m}, 22, camera.name,
                "fill=\"#33312c\" font-weight=\"bold\"");
  if (!camera.covariance) return;
  const Eigen::Matrix<double, 6, 1> variance = camera.covariance->diagonal();
  drawing.label({p[0].x(), p[0].y(), ground_m}, 40,
                text("\u00b1 %.1f mm  \u00b1 %.2f mrad", 1e3 * std::sqrt(variance.head<3>().sum()),
                     1e3 * std::sqrt(variance.tail<3>().sum())),
                "fill=\"#6d685d\" font-size=\"13\"");
}

}  // namespace

std::string to_svg(const Calibration& calibration) {
  std::vector<Points> flights;
  Points everything;
  for (const ThrowEstimate& thrown : calibration.throws) {
    flights.push_back(flight_points(thrown, calibration));
    everything.insert(everything.end(), flights.back().begin(), flights.back().end());
  }
  for (const CameraCalibration& camera : calibration.cameras)
    if (is_drawn(camera)) {
      const Points p = pyramid_points(*camera.T_world_cam);
      everything.insert(everything.end(), p.begin(), p.end());
    }
  if (everything.empty()) everything.push_back(Eigen::Vector3d::Zero());
  Eigen::Vector3d low = everything.front(), high = low;
  for (const Eigen::Vector3d& p : everything) low = low.cwiseMin(p), high = high.cwiseMax(p);
  // Whole metres of ground with half a metre to spare, a little under the lowest thing seen.
  low = (low - Eigen::Vector3d(0.5, 0.5, 0.1)).eval(),
  low.head<2>() = low.head<2>().array().floor();
  high.head<2>() = (high.head<2>().array() + 0.5).ceil();
  for (double x : {low.x(), high.x()})
    for (double y : {low.y(), high.y()}) everything.emplace_back(x, y, low.z());

  Drawing drawing(everything);
  draw_ground(drawing, low, high);
  for (std::size_t j = 0; j < flights.size(); ++j) {
    Points shadow = flights[j];
    for (Eigen::Vector3d& p : shadow) p.z() = low.z();
    drawing.line(shadow, "stroke=\"#c9c4b6\" stroke-width=\"3\"");
  }
  for (std::size_t j = 0; j < flights.size(); ++j) {
    const std::string colour = colours[j % colours.size()];
    drawing.line(flights[j], "stroke=\"" + colour + "\" stroke-width=\"2.5\"");
    for (std::size_t i = 0; i < flights[j].size(); i += 5)
      drawing.dot(flights[j][i], 3.2, "fill=\"" + colour + "\"");
  }
  for (const CameraCalibration& camera : calibration.cameras)
    if (is_drawn(camera)) draw_camera(drawing, camera, low.z());
  return drawing.svg();
}

}  // namespace throwcal
