// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <Eigen/Core>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "estimator/flight_fit.h"
#include "estimator/rigid.h"

namespace throwcal {

/// One flight as cameras a and b see it.
using FlightPair = std::pair<CameraFlight, CameraFlight>;

/// Where camera b stands in camera a's axes, and how its clock stands to a's.
struct CameraAlignment {
  Rigid T_a_b;
  /// Contract's offset of b minus that of a: time on a's clock = time on b's clock + this.
  double offset_b_minus_a_s = 0.0;
  /// Of (heading about the vertical [rad], translation in a's axes [m], offset [s]); the offset's
  /// row is zero where it was not estimated. Both tilts come from gravity and are not in it.
  Eigen::Matrix<double, 5, 5> covariance = Eigen::Matrix<double, 5, 5>::Zero();
  double slack_rad = 0.003, slack_mps = 0.02;  ///< of the settings that it was made with
  double chi2 = 0.0;                           ///< over the pairs used
  std::vector<bool> used;  ///< a flag for each pair given; false: it contradicts the others
};

struct AlignmentSettings {
  bool estimate_offset = true;
  double max_offset_s = 0.05;  ///< an alignment past it is none
  double gate_chi2 = 30.0;     ///< a pair further off than this (6 degrees of freedom) is wrong
  /// What a flight's own covariance does not hold: the tilt that all flights of a camera share,
  /// spin, a drag taken as known; of direction, and of velocity.
  double slack_rad = 0.003, slack_mps = 0.02;
  double max_sigma_heading_rad = 0.3;  ///< past it the heading is not known and there is no result
};

/// Relative pose and clock of two cameras from flights that both see; one is enough if it is no
/// vertical drop. Apex times give the offset, horizontal velocities and positions the heading,
/// positions the translation; weighted least squares over whole flights finishes. Survives wrong
/// pairs as long as the right ones are more than any other set that agrees. Of more than 24 pairs,
/// 24 spread over all tell it: it is where the refinement starts, and that takes them all. Nothing
/// where the heading stays unknown (drops from one spot) or no pair fits.
std::optional<CameraAlignment> align_cameras(std::span<const FlightPair> shared,
                                             const AlignmentSettings& settings = {});

/// How badly a pair of flights contradicts an alignment: squared difference of position and
/// velocity in the middle of their common time over its covariance, the alignment's included; 6
/// degrees of freedom for a pair that had no part in the alignment.
double mismatch_chi2(const CameraAlignment& alignment, const CameraFlight& a,
                     const CameraFlight& b);

/// One flight as both cameras see it, in a's axes: what a sees minus what b sees in the middle of
/// their common time.
struct FlightDifference {
  Eigen::Matrix<double, 6, 1> value;       ///< position [m], velocity [m/s]
  Eigen::Matrix<double, 6, 6> covariance;  ///< the alignment's own not included
  Eigen::Matrix<double, 6, 5> J;           ///< by heading, translation, offset, where it vanishes

  double chi2() const;
};
FlightDifference difference(const CameraAlignment& at, const CameraFlight& a,
                            const CameraFlight& b);

/// Moment of the highest point on the flight's own clock, seconds after the flight's epoch.
double apex_s(const CameraFlight& flight);

/// Rotation from camera axes to level ones (z up); the heading is arbitrary.
Eigen::Matrix3d level_rotation(const Eigen::Vector3d& gravity_cam);

}  // namespace throwcal
