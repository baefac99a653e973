// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "estimator/time.h"

namespace throwcal {

using CameraId = std::uint32_t;  ///< position in the rig file; camera 1 is 0
using ThrowId = std::string;     ///< any label

/// A ball, or a blob that may be one, in one frame.
struct BallSighting {
  CameraId camera = 0;
  /// Middle of the exposure of the frame's first row. A rolling shutter saw the ball at time +
  /// row_time * v.
  HostTime time{};
  Eigen::Vector2d center_px =
      Eigen::Vector2d::Zero();  ///< distorted projection of the ball's centre (u, v)
  Eigen::Matrix2d cov_px2 = Eigen::Matrix2d::Identity();
  std::optional<double> radius_px;  ///< apparent radius, where the detector measured one
  std::uint64_t id = 0;  ///< unique in a recording: row of the sightings file, or a running count
  bool is_partial = false;  ///< cut by the picture's edge, or something stood before it
};

/// All that one camera saw in one frame, empty frames included (they tell that the ball was not
/// seen).
struct FrameSightings {
  CameraId camera = 0;
  HostTime time{};
  std::vector<BallSighting> sightings;
};

/// One flight in one camera, time ascending.
struct Track {
  CameraId camera = 0;
  std::vector<BallSighting> sightings;
  /// Nothing was seen near where the ball came from (went to) just before (after): no hand that
  /// threw it, no bounce, whose first frame could pass for flight.
  bool begins_clear = false, ends_clear = false;
};

/// One flight, seen by one camera or more; at most one track a camera.
struct Throw {
  ThrowId id;
  std::vector<Track> tracks;
};

/// A ball in free flight: where it is and how it moves at `start`, in world axes, on camera 1's
/// clock.
struct Flight {
  HostTime start{};
  Eigen::Vector3d position_world_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d velocity_world_mps = Eigen::Vector3d::Zero();
  double drag_per_m = 0.0;
};

}  // namespace throwcal
