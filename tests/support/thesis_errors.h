// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <limits>

#include "estimator/calibration.h"
#include "estimator/ekf.h"
#include "tests/support/thesis_rig.h"

namespace throwcal::test {

constexpr double unreadable = std::numeric_limits<double>::quiet_NaN();

/// Errors as the thesis forms them: one norm over the five angles, one over camera 2's centre (its
/// own printed vectors give its printed errors so), and each camera's mean re-projection distance.
struct ThesisErrors {
  double zxz_rad = 0.0;
  double angle_rad = 0.0;  ///< the norm of both rotations' errors on SO(3)
  double centre_m = 0.0;
  /// The same two after camera 2 is turned about the first ball's vertical to its true bearing:
  /// what a drop does determine.
  double turned_angle_rad = 0.0, turned_centre_m = 0.0;
  std::array<double, 2> reprojection_px{};
};

/// What the thesis prints at an experiment's end.
struct ThesisResult {
  ThesisCameras cameras = ThesisCameras::Zero();
  std::array<double, 2> reprojection_px{};  ///< NaN: the scan has lost a digit
  ThesisBall ball = {};                     ///< the line of a drop; else not used
};

ThesisErrors errors_of(const ThesisExperiment& experiment, const ThesisResult& result);

/// A filter from the experiment's guess.
struct ThesisFilter {
  Method method = Method::rb_ekf;
  EkfSettings ekf = {};
  int sweeps = 30;  ///< calibrate()'s number, for the thesis' 1000 "throw iterations"
};

/// A start that R-EKF is told of: somewhere near its guess, and nearly at rest. These sigmas stand
/// beside the filter's inflated noise, not beside the centroids' own, so they are wide.
constexpr EkfSettings let_go{.prior_ball_position_m = 0.5, .prior_ball_velocity_mps = 0.1};

/// RMS errors over the recordings of seeds 1 to `seeds`: of a filter from the experiment's guess,
/// of calibrate() without one, and of the truth itself (its re-projection error is the noise).
ThesisErrors filter_errors(const ThesisExperiment& experiment, const ThesisFilter& filter,
                           int seeds);
struct ThesisFull {
  ThesisErrors errors;                 ///< of the recordings that are not called unobservable
  int accepted = 0, unobservable = 0;  ///< recordings with that verdict
};
ThesisFull full_errors(const ThesisExperiment& experiment, int seeds);
ThesisErrors truth_errors(const ThesisExperiment& experiment, int seeds);

/// The RMS errors that theory predicts to first order, by numeric derivatives (nothing of the
/// estimator but lens and flight).
struct ThesisBounds {
  ThesisErrors cramer_rao;  ///< no unbiased estimator is better, even one that knows all the noise
  /// The best estimator that takes every centroid's noise as its own and alike. It differs from
  /// the bound where the ball itself is disturbed, for both cameras see the same disturbance.
  ThesisErrors least_squares;
};
ThesisBounds bounds_of(const ThesisExperiment& experiment);

}  // namespace throwcal::test
