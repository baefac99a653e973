// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace throwcal {

constexpr double square(double x) { return x * x; }

/// The estimator's own, for a C library's differ in the last bit by version and by processor. These
/// use + - * / and exact functions only, which IEEE 754 fixes to the bit, so every machine gives
/// the same.
namespace elementary {

/// Wrong by less than a unit in the last place; beyond 3000 rad by half of the argument's own.
double sin(double angle_rad);
double cos(double angle_rad);
/// Wrong by 0.51 units at most. With std::atan2's answers for zeros and infinities.
double atan2(double y, double x);
/// Wrong by less than a unit.
double log(double x);
double exp(double x);

}  // namespace elementary
}  // namespace throwcal
