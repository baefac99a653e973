// SPDX-License-Identifier: BSD-3-Clause
#include "capture/sensor_noise.h"

#include <algorithm>
#include <cmath>

namespace throwcal {
namespace {

constexpr double read_noise = 1.6, photon_gain = 0.03;  ///< 2 to 3 grey levels in the mid-tones
constexpr double normal_unit = 24.0;  ///< steps of the tile in one standard deviation
constexpr int scale_bits = 2;
constexpr std::size_t tile_size = 1 << 18;
constexpr std::uint64_t tile_seed = 20081123;

/// White noise, drawn once: each row of each frame starts somewhere else in it.
const std::vector<std::int8_t>& noise_tile() {
  static const std::vector<std::int8_t> tile = [] {
    std::vector<std::int8_t> drawn(tile_size);
    Dice dice(tile_seed);
    for (auto& value : drawn)
      value = static_cast<std::int8_t>(
          std::clamp(std::round(normal_unit * dice.normal()), -127.0, 127.0));
    return drawn;
  }();
  return tile;
}

inline std::uint8_t developed(std::int16_t clean, std::uint8_t scale, std::int8_t noise) {
  // At most 255 * 64 + (127 * 255 >> 2), which 16 bits hold.
  const auto noisy = static_cast<std::int16_t>(
      clean + static_cast<std::int16_t>(static_cast<std::int16_t>(noise * scale) >> scale_bits) +
      grey_unit / 2);
  const auto grey = static_cast<std::int16_t>(noisy >> 6);
  return static_cast<std::uint8_t>(std::clamp<std::int16_t>(grey, 0, 255));
}

void develop_row(const std::int16_t* __restrict clean, const std::uint8_t* __restrict scale,
                 const std::int8_t* __restrict noise, int width, std::uint8_t* __restrict out) {
  constexpr int block = 32;  // a constant count: what the compiler turns into vector instructions
  int x = 0;
  for (; x + block <= width; x += block)
    for (int i = 0; i < block; ++i)
      out[x + i] = developed(clean[x + i], scale[x + i], noise[x + i]);
  for (; x < width; ++x) out[x] = developed(clean[x], scale[x], noise[x]);
}

}  // namespace

std::vector<std::uint8_t> noise_scales() {
  std::vector<std::uint8_t> scales;
  for (int grey = 0; grey < 256; ++grey) {
    const double sigma = std::sqrt(read_noise * read_noise + photon_gain * grey);
    scales.push_back(static_cast<std::uint8_t>(
        std::lround(sigma * grey_unit * (1 << scale_bits) / normal_unit)));
  }
  return scales;
}

void add_sensor_noise(const cv::Mat& clean, const cv::Mat& scale, Dice dice, std::uint8_t* pixels) {
  const auto& tile = noise_tile();
  const auto starts = tile_size - static_cast<std::size_t>(clean.cols);
  for (int y = 0; y < clean.rows; ++y)
    develop_row(clean.ptr<std::int16_t>(y), scale.ptr<std::uint8_t>(y),
                tile.data() + dice.bits() % starts, clean.cols,
                pixels + static_cast<std::ptrdiff_t>(y) * clean.cols);
}

}  // namespace throwcal
