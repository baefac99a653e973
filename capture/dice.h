// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <cstdint>

namespace throwcal {

/// Random numbers that are the same on every machine and library (the standard's distributions are
/// not). SplitMix64; a stream is named by up to three numbers, so that the n-th throw needs no
/// throw before it.
class Dice {
 public:
  explicit Dice(std::uint64_t seed, std::uint64_t stream = 0, std::uint64_t index = 0)
      : state_(mixed(seed + golden * (stream + 1) + mixed(index + golden))) {}

  std::uint64_t bits() { return mixed(state_ += golden); }
  double uniform(double low, double high) {
    return low + (high - low) * static_cast<double>(bits() >> 11) * 0x1p-53;
  }
  /// Zero mean, unit variance; a sum of twelve uniforms, so within +-6.
  double normal() {
    double sum = -6.0;
    for (int i = 0; i < 12; ++i) sum += uniform(0.0, 1.0);
    return sum;
  }

 private:
  static constexpr std::uint64_t golden = 0x9E3779B97F4A7C15u;
  static constexpr std::uint64_t mixed(std::uint64_t x) {
    x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9u;
    x = (x ^ (x >> 27)) * 0x94D049BB133111EBu;
    return x ^ (x >> 31);
  }
  std::uint64_t state_;
};

}  // namespace throwcal
