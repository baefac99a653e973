// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <string>

#include "estimator/calibration.h"

namespace throwcal {

/// A drawing of a calibrated rig (SVG): every placed camera with its name and 1-sigma, every flight
/// with its shadow on the ground, on a grid of metres. Seen obliquely from above, without
/// perspective, so that lengths can be compared.
std::string to_svg(const Calibration& calibration);

}  // namespace throwcal
