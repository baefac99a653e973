// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "estimator/observation.h"
#include "estimator/rigid.h"

namespace throwcal {

enum class Verdict {
  accepted,
  needs_more_throws,  ///< determined, but not to the target
  unobservable,       ///< some direction of the solution is not determined by these throws
  rejected,           ///< the data contradict the model
};

enum class Method { ekf, r_ekf, rb_ekf, full };

using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// A number of a camera's model that the rig file asked to estimate.
struct LensEstimate {
  std::string name;    ///< as the rig file calls it: "fx_px", "k1", "row_time_s"
  double value = 0.0;  ///< in its own unit
  double sigma = 0.0;
};

struct CameraCalibration {
  std::string name;
  std::optional<Rigid> T_world_cam;  ///< absent where no throw tells where the camera is
  /// Of (x, y, z, rx, ry, rz): translation error in world axes [m] and rotation error as a
  /// world-axes rotation vector [rad], R_true = exp([r]x) R_estimate. Camera 1's position rows are
  /// zero; its rotation rows carry its two tilts.
  std::optional<Matrix6d> covariance;
  double time_offset_s = 0.0;  ///< t_true = time_s + time_offset_s; camera 1's is 0
  std::optional<double> sigma_time_offset_s;
  /// What was estimated of the model, in the rig file's order.
  std::vector<LensEstimate> lens = {};
  double reprojection_rms_px = 0.0;  ///< of one coordinate, over the sightings used
  int sightings_used = 0, sightings_rejected = 0;
};

struct ThrowEstimate {
  ThrowId id;
  HostTime start{}, end{};  ///< first and last sighting used, camera 1's clock
  Eigen::Vector3d position_world_m = Eigen::Vector3d::Zero();    ///< at `start`
  Eigen::Vector3d velocity_world_mps = Eigen::Vector3d::Zero();  ///< at `start`
  std::vector<CameraId> cameras;
  double reprojection_rms_px = 0.0;
};

/// What became of one sighting of a throw.
struct SightingResidual {
  std::uint64_t sighting_id = 0;  ///< BallSighting::id
  ThrowId throw_id;
  bool used = false;
  Eigen::Vector2d residual_px = Eigen::Vector2d::Zero();  ///< measured minus predicted
};

/// The throw that would lower the worst camera's uncertainty most, among those the cameras can see.
struct NextThrow {
  Eigen::Vector3d position_world_m = Eigen::Vector3d::Zero();    ///< where the ball leaves the hand
  Eigen::Vector3d velocity_world_mps = Eigen::Vector3d::Zero();  ///< and how
  std::vector<CameraId> cameras;                                 ///< that would see it
  CameraId camera = 0;                                      ///< the worst, measured by the target
  double sigma_position_m = 0.0, sigma_rotation_rad = 0.0;  ///< its norms of three sigmas, now
  double expected_sigma_position_m = 0.0, expected_sigma_rotation_rad = 0.0;  ///< and after it
  std::string text;  ///< the same in words, for who throws
};

/// The result: an immutable value once published.
struct Calibration {
  Method method = Method::full;
  Verdict verdict = Verdict::rejected;
  std::vector<std::string> reasons;  ///< sentences for a field worker; empty only when accepted
  double gravity_mps2 = 0.0;
  std::string gravity_source;
  double drag_per_m = 0.0;
  std::optional<double> sigma_drag_per_m;
  std::vector<CameraCalibration> cameras;  ///< in the rig's order
  std::vector<ThrowEstimate> throws;
  std::vector<SightingResidual> residuals;
  std::optional<NextThrow> next_throw = {};
};

}  // namespace throwcal
