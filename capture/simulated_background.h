// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <opencv2/core.hpp>

#include "capture/dice.h"

namespace throwcal {

/// A cluttered still picture [grey levels, CV_32F]: soft texture of several scales, bars and boxes
/// with sharp edges, and a few discs that look like the ball but stay where they are.
cv::Mat simulated_background(int width_px, int height_px, Dice dice);

}  // namespace throwcal
