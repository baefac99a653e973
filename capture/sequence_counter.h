// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <cstdint>
#include <optional>

namespace throwcal {

/// A driver's 32-bit frame counter, carried on beyond its wrap: the first frame is 0, and a step of
/// more than one is frames lost.
class SequenceCounter {
 public:
  std::uint64_t extend(std::uint32_t drivers) {
    if (!last_) {
      last_ = drivers;
      return ++value_;
    }
    const std::uint32_t step = drivers - *last_;  // modulo 2^32
    last_ = drivers;
    counts_ |= step != 0;
    // A driver that does not count, or began anew by itself: no frame is known to be lost.
    return value_ += step == 0 || step > most_lost ? 1 : step;
  }

  /// The stream begins anew, and so may the driver's counter.
  void restart() { last_.reset(); }

  bool is_new() const { return !last_; }  ///< of a stream that has not given a frame

  /// False: the driver's counter stands still, so that losses cannot be seen in it.
  bool counts() const { return counts_; }

 private:
  static constexpr std::uint32_t most_lost = 1u << 31;
  std::optional<std::uint32_t> last_;
  std::uint64_t value_ = ~std::uint64_t{0};
  bool counts_ = false;
};

}  // namespace throwcal
