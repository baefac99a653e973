// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "capture/simulated_scene.h"

namespace throwcal {

/// What one simulated camera's sensor sees: a cluttered, still background, an arm that swings, a
/// shaded ball blurred by its motion, vignetting and noise. Only what moves is painted anew.
class SimulatedPicture {
 public:
  SimulatedPicture(std::shared_ptr<const SimulatedScene> scene, CameraId camera);

  /// Exposes the frame whose first row's exposure has its middle at a true time [s] into width x
  /// height grey bytes. The same number and time, the same bytes.
  void expose(double row0_mid_exposure_s, std::uint64_t number, std::uint8_t* pixels);

 private:
  void paint_arm(double time_s);
  void paint_ball(double row0_mid_exposure_s);
  double time_of_ball_row(double row0_mid_exposure_s) const;
  cv::Rect touch(cv::Rect region);
  void blend(int x, int y, double coverage, double grey);
  double vignette(double x, double y) const;
  void forget_what_moved();

  std::shared_ptr<const SimulatedScene> scene_;
  CameraId camera_;
  CameraModel model_;
  Rigid T_cam_world_;
  Eigen::Vector3d light_cam_;              ///< towards the light
  cv::Mat still_, still_noise_;            ///< background: grey level * 64, scale of its noise
  cv::Mat canvas_, canvas_noise_;          ///< the same with what moves
  cv::Mat arm_mask_;                       ///< coverage by the arm, 0 to 255
  std::vector<cv::Rect> touched_;          ///< where the canvas differs from the background
  std::vector<std::uint8_t> noise_scale_;  ///< of a grey level
};

}  // namespace throwcal
