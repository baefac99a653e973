// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <optional>
#include <string>

#include "estimator/calibration.h"

namespace throwcal {

/// The true calibration's error of one camera.
struct CameraError {
  double position_m = 0.0, rotation_rad = 0.0, time_offset_s = 0.0;
  /// The worst of the six components in units of its own stated sigma; nothing where none is
  /// stated.
  std::optional<double> worst_sigmas;
};
CameraError error_of(const CameraCalibration& estimate, const CameraCalibration& truth);

/// 1-sigma of a camera, norm of the three of its position and of the three of its rotation.
struct CameraSigma {
  double position_m = 0.0, rotation_rad = 0.0;
};
std::optional<CameraSigma> sigma_of(const CameraCalibration& camera);

/// What a person wants to read: a line a camera (position, orientation in degrees, 1-sigma, time
/// offset, residual), with the true error beside it where the truth is known, and the verdict.
std::string calibration_table(const Calibration& calibration,
                              const std::optional<Calibration>& truth = {});

}  // namespace throwcal
