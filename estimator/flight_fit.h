// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <Eigen/Core>
#include <optional>
#include <span>
#include <vector>

#include "estimator/ballistics.h"
#include "estimator/camera_model.h"
#include "estimator/observation.h"

namespace throwcal {

/// A sighting as the estimator's single-camera mathematics wants it: undistorted, with its noise.
struct TimedRay {
  double time_s = 0.0;  ///< of the ball's own row, relative to an epoch that the owner keeps
  Eigen::Vector3d direction_cam;  ///< unit
  /// Whitened pixel residual of a camera-frame direction near the ray: `whitener * n` with |n| = 1
  /// has unit covariance where n points at the ball. Annihilates the ray itself. [1]
  Eigen::Matrix<double, 2, 3> whitener;
};

/// Nothing where the lens has no ray for the pixel or the covariance is not positive definite.
std::optional<TimedRay> timed_ray(const CameraModel& model, const BallSighting& sighting,
                                  HostTime epoch);

/// One flight as one camera alone sees it, camera axes: |gravity| is the ruler, so it is metric.
struct CameraFlight {
  CameraId camera = 0;
  HostTime epoch{};                                  ///< middle of the track, this camera's clock
  Eigen::Vector3d position_cam_m, velocity_cam_mps;  ///< at `epoch`
  Eigen::Vector3d gravity_cam_mps2;                  ///< points down
  double drag_per_m = 0.0;
  /// Of the errors of (position, velocity, gravity, drag). Gravity's length is known: its block has
  /// rank 2, or is zero where gravity was given; drag's is zero where drag was given.
  Eigen::Matrix<double, 10, 10> covariance;
  double chi2 = 0.0;  ///< of the sightings used, against the noise that they state
  int dof = 0;
  double noise_scale = 1.0;  ///< true noise over stated noise; 1 where it was taken as known
  double first_s = 0.0, last_s = 0.0;  ///< of the sightings used, relative to `epoch`
  std::vector<bool> used;              ///< a flag for each sighting given; false: an outlier

  /// Position and velocity in camera axes at `epoch + time_s`.
  BallState at(double time_s) const;
  /// Covariance of (position, velocity) at `epoch + time_s`.
  Eigen::Matrix<double, 6, 6> covariance_at(double time_s) const;
};

struct FlightFitSettings {
  double gravity_mps2 = 9.80665;
  double drag_per_m = 0.0;
  double sigma_drag_per_m = 0.0;  ///< 0: drag is known; else it is estimated, with this prior
  std::optional<Eigen::Vector3d> gravity_cam_mps2;  ///< where known in camera axes
  double sigma_gravity_rad = 0.0;  ///< of that, each way; 0: only position and velocity are fitted
  bool noise_known = true;  ///< false: the residuals' own spread replaces the stated noise's scale
  bool search_outliers =
      true;  ///< survive gross outliers; false is faster and for clean candidates
  double outlier_sigmas = 4.0;
  double max_relative_sigma_depth = 0.5;  ///< past it nothing is returned: distance is not known
};

/// Fits a flight to one camera's sightings (times ascending). Starts from the closed form: with
/// rays x_i at t_i, x_i x (P + V t_i + a t_i^2 / 2) = 0 is linear in (P, V, a), scaled to |a| = g;
/// then least squares on the reprojection error, |a| = g kept. Nothing where the sightings do not
/// determine a flight in front of the camera: too few, at rest, straight and uniform.
std::optional<CameraFlight> fit_flight(const CameraModel& model,
                                       std::span<const BallSighting> sightings,
                                       const FlightFitSettings& settings = {});

/// The same from rays, times relative to `epoch`; the result's epoch is the middle of the span.
std::optional<CameraFlight> fit_flight(CameraId camera, HostTime epoch,
                                       std::span<const TimedRay> rays,
                                       const FlightFitSettings& settings = {});

/// What a camera's flights say of gravity: weighted mean of the heaviest cluster of directions
/// within 10 degrees.
struct GravityEstimate {
  Eigen::Vector3d gravity_cam_mps2;
  double sigma_rad = 0.0;  ///< each way, if the flights' own covariances are right
  int flights = 0;         ///< in the cluster
};
std::optional<GravityEstimate> estimate_gravity(std::span<const CameraFlight> flights);

/// Its mean alone [m/s^2]. Nothing without a flight.
std::optional<Eigen::Vector3d> mean_gravity(std::span<const CameraFlight> flights);

}  // namespace throwcal
