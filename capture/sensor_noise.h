// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "capture/dice.h"

namespace throwcal {

constexpr int grey_unit = 64;  ///< a clean picture's steps in one grey level

/// Standard deviation of a pixel's noise, as add_sensor_noise() takes it, by grey level 0 to 255:
/// variance = read^2 + gain * grey level.
std::vector<std::uint8_t> noise_scales();

/// Adds noise to a clean picture (CV_16S, grey level * grey_unit; `scale` CV_8U from
/// noise_scales()) and rounds it to bytes, tightly packed.
void add_sensor_noise(const cv::Mat& clean, const cv::Mat& scale, Dice dice, std::uint8_t* pixels);

}  // namespace throwcal
