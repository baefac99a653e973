// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <cstdint>
#include <opencv2/core.hpp>

namespace throwcal {

// Loops over every pixel, compiled to SIMD where OpenCV has none.

/// Takes one channel (0: YUYV's luma, 1: UYVY's) out of a picture of two bytes a pixel, into one of
/// the same size and one byte.
void take_luma(const cv::Mat& packed, int channel, cv::Mat luma);

/// The row between two others, rounded up where it falls between two grey levels.
void write_mean(const std::uint8_t* above, const std::uint8_t* below, int count, std::uint8_t* out);

}  // namespace throwcal
