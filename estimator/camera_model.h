// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <Eigen/Core>
#include <array>
#include <optional>
#include <string>

namespace throwcal {

enum class Lens {
  radtan,  ///< OpenCV's k1 k2 p1 p2 k3 on x/z, y/z
  kb4,     ///< OpenCV's fisheye (Kannala-Brandt), k1..k4 on the angle off the axis
};

/// The numbers of a CameraModel that a calibration may estimate beside the pose.
enum class Intrinsic { fx, fy, cx, cy, skew, d0, d1, d2, d3, d4, row_time };
constexpr int intrinsics = 11, lens_intrinsics = 10;  ///< all; those that shape the picture

/// Intrinsics of one camera. Camera frame: x right, y down, z forward. Pixel (0, 0) is the centre
/// of the top-left pixel. u = fx x + skew y + cx, v = fy y + cy, with (x, y) the distorted
/// normalised coordinates.
struct CameraModel {
  Lens lens = Lens::radtan;
  int width_px = 0, height_px = 0;
  double fx_px = 1.0, fy_px = 1.0, cx_px = 0.0, cy_px = 0.0, skew_px = 0.0;
  std::array<double, 5> distortion{};  ///< in OpenCV's order; kb4 uses the first four
  double row_time_s =
      0.0;  ///< rolling shutter: exposure of row n starts n * row_time_s later; 0 = global

  /// Pixel of a camera-frame point [m] and, where asked, d pixel / d point (2x3, px/m) and
  /// d pixel / d intrinsics (2x10, in Intrinsic's order). Nothing where the lens cannot see the
  /// point: behind a radtan camera, or past the angle where its distortion turns back on itself.
  std::optional<Eigen::Vector2d> project(
      const Eigen::Vector3d& point_cam, Eigen::Matrix<double, 2, 3>* J_point = nullptr,
      Eigen::Matrix<double, 2, lens_intrinsics>* J_intrinsics = nullptr) const;

  /// Unit viewing ray of a distorted pixel; nothing where no ray within the lens' valid cone maps
  /// there.
  std::optional<Eigen::Vector3d> unproject(const Eigen::Vector2d& pixel) const;

  /// Largest angle off the axis [rad] up to which the distortion grows monotonically.
  double max_angle_rad() const;

  double& at(Intrinsic which);
  double at(Intrinsic which) const { return const_cast<CameraModel&>(*this).at(which); }

  /// Whether a pixel lies inside the picture, at least `margin_px` from its edge.
  bool contains(const Eigen::Vector2d& pixel, double margin_px = 0.0) const;
};

/// As the rig file calls it ("fx_px", "k1", "row_time_s"); empty where this lens has no such
/// number.
std::string name_of(Intrinsic which, Lens lens);

}  // namespace throwcal
