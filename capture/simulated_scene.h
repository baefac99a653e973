// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "estimator/observation.h"
#include "estimator/rig_description.h"
#include "estimator/rigid.h"

namespace throwcal {

struct SimulatedSceneSettings {
  std::uint64_t seed = 1;
  int cameras = 4;      ///< 2 to 8, evenly on a circle through a square's corners
  double side_m = 6.0;  ///< of that square
  int width_px = 640, height_px = 480;
  double focal_px = 480.0;
  double frames_per_s = 60.0;
  double max_offset_s = 0.015;  ///< each further camera's clock is off by up to this
  double drag_per_m = 0.0175;   ///< a tennis ball's
  double row_time_s = 0.0;
  double throw_interval_s = 2.2;
  double exposure_s = 0.002;
};

/// A seeded site: cameras around a person who throws a tennis ball every few seconds, for ever.
/// Everything is a pure function of the seed and of true time [s] since the scene's start, so that
/// any number of cameras see the same ball. World frame and signs as in the rig's calibration:
/// origin at camera 1, z up, x along its level heading.
class SimulatedScene {
 public:
  explicit SimulatedScene(const SimulatedSceneSettings& settings);

  struct Arc {
    int number = 0;  ///< 0, 1, ...: the throw
    bool after_bounce = false;
    double start_s = 0.0, end_s = 0.0;                     ///< true time
    Eigen::Vector3d position_world_m, velocity_world_mps;  ///< at start_s
  };
  struct Ball {
    Eigen::Vector3d position_world_m;
    bool in_hand = false;
    int throw_number = 0;
    bool after_bounce = false;
  };

  const SimulatedSceneSettings& settings() const { return settings_; }
  RigDescription rig()
      const;  ///< what the rig file would say: intrinsics, no poses, drag "estimate"
  Rigid T_world_cam(CameraId camera) const;
  double time_offset_s(CameraId camera) const;  ///< t_true = time_s + time_offset_s; 0 for camera 1
  double frame_phase_s(CameraId camera) const;  ///< true time of the camera's frame 0
  std::optional<Ball> ball_at(double time_s) const;
  std::optional<Eigen::Vector3d> hand_at(
      double time_s) const;  ///< also follows through after release
  std::vector<Arc> arc_list(double from_s, double to_s) const;  ///< that start within the span

 private:
  struct Toss;
  Toss toss(int number) const;
  std::optional<Toss> toss_at(
      double time_s) const;  ///< the one under way, from swing to next swing

  SimulatedSceneSettings settings_;
  Rigid T_world_site_;  ///< site: z up, origin on the ground under the square's middle
  std::vector<Rigid> T_world_cam_;
  std::vector<double> time_offset_s_, frame_phase_s_;
  RigDescription rig_;
};

}  // namespace throwcal
