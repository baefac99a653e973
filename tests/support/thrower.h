// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <cstdint>
#include <numbers>
#include <vector>

#include "estimator/observation.h"
#include "estimator/rig_description.h"
#include "estimator/rigid.h"

namespace throwcal::test {

struct ThrowerSettings {
  std::uint64_t seed = 1;
  int cameras = 4;  ///< on a circle through a square's corners, looking at its middle
  int throws = 5;
  double side_m = 6.0;
  double arc_rad = 2 * std::numbers::pi;  ///< of the circle that the cameras share out
  CameraModel model{.width_px = 1280,
                    .height_px = 720,
                    .fx_px = 900,
                    .fy_px = 900,
                    .cx_px = 639.5,
                    .cy_px = 359.5};  ///< of every camera
  double sigma_px = 0.2;
  bool state_sigma = true;  ///< whether the rig says sigma_px
  double frames_per_s = 60.0;
  double max_offset_s = 0.0;  ///< not 0: free-running cameras, offsets to be estimated
  double drag_per_m = 0.0;
  bool estimate_drag = false;
  double row_time_s = 0.0;
  double duration_s = 0.9;
  double outlier_fraction = 0.0;
  bool vertical_drops = false;
};

/// A recording and its truth, world frame of camera 1.
struct Thrown {
  RigDescription rig;
  std::vector<Rigid> T_world_cam;
  std::vector<double> time_offset_s;
  std::vector<CameraModel> true_models;  ///< what the cameras are; the rig may say otherwise
  std::vector<Flight> flights;           ///< true, start on camera 1's clock
  std::vector<Throw> throws;
};

/// Seeded: the same settings, the same recording.
Thrown make_thrown(const ThrowerSettings& settings);

}  // namespace throwcal::test
