// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <opencv2/core.hpp>

namespace throwcal {

/// Takes one channel (0: YUYV's luma, 1: UYVY's) out of a picture of two bytes a pixel, into one of
/// the same size and one byte.
void take_luma(const cv::Mat& packed, int channel, cv::Mat luma);

}  // namespace throwcal
