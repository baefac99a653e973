// SPDX-License-Identifier: BSD-3-Clause
#include "capture/pixel_rows.h"

namespace throwcal {

namespace {

// cv::extractChannel takes five times as long: it goes byte by byte, this loop becomes SIMD.
void take_every_second(const std::uint8_t* __restrict in, int count, std::uint8_t* __restrict out) {
  for (int i = 0; i < count; ++i) out[i] = in[2 * i];
}

}  // namespace

void take_luma(const cv::Mat& packed, int channel, cv::Mat luma) {
  for (int y = 0; y < packed.rows; ++y)
    take_every_second(packed.ptr(y) + channel, packed.cols, luma.ptr(y));
}

void write_mean(const std::uint8_t* above, const std::uint8_t* below, int count,
                std::uint8_t* __restrict out) {
  for (int i = 0; i < count; ++i) out[i] = static_cast<std::uint8_t>((above[i] + below[i] + 1) / 2);
}

}  // namespace throwcal
