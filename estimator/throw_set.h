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
  double row0_s = 0.0;  ///< middle of the first row's exposure, camera's clock, from the epoch [s]
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

/// When the ball was seen, from the throw's epoch on camera 1's clock [s]. At 8 m/s the ball moves
/// 12 cm while a rolling shutter reads 1080 rows, so the time belongs to the ball's row, not to the
/// frame.
inline double moment_s(const RigState& rig, const TimedSighting& s) {
  return s.row0_s + rig.models[s.camera].row_time_s * s.pixel.y() + rig.time_offset_s[s.camera];
}

/// Measured minus predicted pixel of a sighting, at a ball where it was at that moment; nothing
/// where this lens cannot see it. The rolling shutter's coupling (noise in v also moves the time)
/// is divided out, so that the noise is the centroid's own.
std::optional<Eigen::Vector2d> residual_px(const RigState& rig, const BallState& ball,
                                           const TimedSighting& sighting);

/// The same, linearised; false where it cannot be seen. With `in_sigmas` everything is multiplied
/// by the sighting's whitening.
[[nodiscard]] bool model_sighting(const RigState& rig, const BallState& ball,
                                  const TimedSighting& sighting, bool wants_lens, bool in_sigmas,
                                  SightingModel& out);

}  // namespace throwcal
