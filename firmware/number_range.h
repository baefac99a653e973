// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <limits>
#include <string>

namespace throwcal {

/// Which numbers a place takes, and how that is told: "must be " + text. Never an infinite one or
/// NaN.
struct NumberRange {
  std::string text = "a finite number";
  double low = -std::numeric_limits<double>::infinity();
  double high = std::numeric_limits<double>::infinity();

  bool holds(double value) const;
};

/// "`what` from `low` to `high`"
NumberRange between(double low, double high, const std::string& what = "a number");

}  // namespace throwcal
