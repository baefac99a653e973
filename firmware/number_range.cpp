// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/number_range.h"

#include <cmath>

#include "firmware/text_file.h"

namespace throwcal {

bool NumberRange::holds(double value) const {
  return std::isfinite(value) && value >= low && value <= high;
}

NumberRange between(double low, double high, const std::string& what) {
  return {
      .text = what + " from " + shortest(low) + " to " + shortest(high), .low = low, .high = high};
}

}  // namespace throwcal
