// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "estimator/camera_model.h"

namespace throwcal {

struct CameraDescription {
  std::string name;
  CameraModel model;
  std::optional<double>
      sigma_px;  ///< 1-sigma of one centroid coordinate; absent: estimated from the residuals
  /// 1-sigma, each axis, of the part of the centre's error that all sightings of this camera share
  /// (a lit side, a lens off by a fraction of a pixel). It does not average out, so it is
  /// considered in the result's covariance, beside the noise.
  double sigma_common_px = 0.0;
  /// Numbers of the model that are only roughly known and estimated with the rest.
  std::vector<Intrinsic> estimate = {};
};

struct BallDescription {
  double diameter_m = 0.0657;  ///< a tennis ball's
  double drag_per_m = 0.0;     ///< where drag is not estimated; else the start of its estimate
  bool estimate_drag = false;
};

/// When it is enough: norm of the three sigmas, each camera.
struct Target {
  double position_m = 0.005;
  double rotation_rad = 0.002;
};

/// What is known of a rig before a calibration: everything but where the cameras stand. (The rig
/// file, parsed.)
struct RigDescription {
  double gravity_mps2 = 9.80665;
  std::string gravity_source = "default";
  BallDescription ball;
  Target target;
  bool estimate_offsets = true;  ///< one clock offset for every camera but the first
  std::vector<CameraDescription> cameras;
};

}  // namespace throwcal
