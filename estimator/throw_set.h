// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <Eigen/Core>
#include <optional>
#include <vector>

#include "estimator/ballistics.h"
#include "estimator/observation.h"
#include "estimator/rig_description.h"
#include "estimator/super_state.h"

namespace throwcal {

/// One sighting as the filters and the refinement read it.
struct TimedSighting {
  CameraId camera = 0;
  /// When the ball was seen, by the camera's own clock, from the throw's epoch [s]. A rolling
  /// shutter's row is in it: at 8 m/s the ball moves 12 cm while 1080 rows are read, so the time
  /// belongs to the ball's row, not to the frame.
  double time_s = 0.0;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  Eigen::Matrix2d whitening = Eigen::Matrix2d::Identity();  ///< W with W^T W = cov_px2^-1 [1/px]
  std::uint64_t id = 0;
};

/// One throw: its sightings by all cameras in order of time.
struct TimedThrow {
  ThrowId id;
  HostTime epoch{};  ///< the middle of the sightings
  std::vector<TimedSighting> sightings;
};

/// All throws. Where the rig states no sigma the detector's covariance stands, until the residuals
/// have spoken.
std::vector<TimedThrow> time_throws(const RigDescription& rig, const std::vector<Throw>& throws);

/// The prediction of one sighting and its derivatives, at a ball that is at the moment it was seen.
/// Residuals and Jacobians are in pixels; the rolling shutter's coupling (noise in v also moves the
/// time) is divided out, so that the noise is the centroid's own.
struct SightingModel {
  Eigen::Vector2d residual_px;             ///< measured minus predicted
  Eigen::Matrix<double, 2, 3> J_position;  ///< d predicted / d ball position, world axes
  Eigen::Matrix<double, 2, slice::camera_size> J_camera;  ///< d predicted / d camera's block
};

/// Linearises a sighting; nothing where the ball is where this lens cannot see it.
std::optional<SightingModel> model_sighting(const CameraModel& model, const Rigid& T_world_cam,
                                            const BallState& ball, const TimedSighting& sighting);

}  // namespace throwcal
