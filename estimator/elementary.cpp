// SPDX-License-Identifier: BSD-3-Clause
// Taylor's series on short ranges. What brings an argument there and back: Cody and Waite,
// "Software Manual for the Elementary Functions", 1980 (a constant in parts whose multiples are
// exact); T. J. Dekker, "A floating-point technique for extending the available precision", 1971.
#include "estimator/elementary.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

namespace throwcal::elementary {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();
constexpr double infinity = std::numeric_limits<double>::infinity();

/// The sum of two doubles that do not overlap.
struct Pair {
  double high, low;
};

constexpr Pair pi{0x1.921fb54442d18p+1, 0x1.1a62633145c07p-53};
constexpr Pair half_pi{0x1.921fb54442d18p+0, 0x1.1a62633145c07p-54};

/// c[0] + c[1] x + c[2] x^2 + ...
template <std::size_t n>
double polynomial(const std::array<double, n>& c, double x) {
  double sum = c[n - 1];
  for (std::size_t i = n - 1; i-- > 0;) sum = c[i] + x * sum;
  return sum;
}

Pair sum_of_larger_and(double larger, double other) {
  const double sum = larger + other;
  return {sum, (larger - sum) + other};
}

Pair difference(double a, double b) {
  const double high = a - b, minus_b = high - a;
  return {high, (a - (high - minus_b)) - (b + minus_b)};
}

/// The upper 26 bits, and the rest.
Pair split(double a) {
  const double shifted = 134217729.0 * a, high = shifted - (shifted - a);
  return {high, a - high};
}

Pair product(double a, double b) {
  const double high = a * b;
  const Pair p = split(a), q = split(b);
  return {high, ((p.high * q.high - high) + p.high * q.low + p.low * q.high) + p.low * q.low};
}

/// An angle as quarter turns, 0 to 3, and at most an eighth turn more.
struct Turned {
  int quarters;
  Pair rest;
};

Turned turned(double angle) {
  constexpr double far = 3000.0, two_pi = 2 * std::numbers::pi;
  constexpr double first = 0x1.921fb54442000p+0, second = 0x1.a308d31318000p-41,
                   third = 0x1.8a2e03707344ap-81;  // pi/2: 40 bits, 40 bits and 53
  if (std::abs(angle) <= 0.25 * std::numbers::pi) return {0, {angle, 0.0}};
  if (!std::isfinite(angle)) return {0, {nan, nan}};
  if (std::abs(angle) > far) angle = std::fmod(angle, two_pi);
  const double n = std::floor(angle * (2 / std::numbers::pi) + 0.5);
  const Pair near = difference(angle - n * first, n * second);
  return {static_cast<int>(n) & 3, sum_of_larger_and(near.high, near.low - n * third)};
}

double sin_of(const Pair& x) {
  constexpr std::array<double, 8> series{
      -1.0 / 6,        1.0 / 120,          -1.0 / 5040,         1.0 / 362880,
      -1.0 / 39916800, 1.0 / 6227020800.0, -1.0 / 1307674368e3, 1.0 / 355687428096e3};
  const double x2 = x.high * x.high;
  return x.high + (x.high * x2 * polynomial(series, x2) + x.low * (1 - 0.5 * x2));
}

double cos_of(const Pair& x) {
  constexpr std::array<double, 8> series{
      1.0 / 24,        -1.0 / 720,           1.0 / 40320,         -1.0 / 3628800,
      1.0 / 479001600, -1.0 / 87178291200.0, 1.0 / 20922789888e3, -1.0 / 6402373705728e3};
  const double x2 = x.high * x.high, half = 0.5 * x2, start = 1 - half;
  return start + (((1 - start) - half) + (x2 * x2 * polynomial(series, x2) - x.high * x.low));
}

double sin_after(int quarters, const Pair& rest) {
  const double value = quarters & 1 ? cos_of(rest) : sin_of(rest);
  return quarters & 2 ? -value : value;
}

/// atan(a / b) of 0 <= a <= b: the angle of the nearest eighth, and a short series.
Pair atan_of_ratio(double a, double b) {
  constexpr std::array<Pair, 9> of_eighth{{{0.0, 0.0},
                                           {0x1.fd5ba9aac2f6ep-4, -0x1.cd37686760c17p-59},
                                           {0x1.f5b75f92c80ddp-3, 0x1.8ab6e3cf7afbdp-57},
                                           {0x1.6f61941e4def1p-2, -0x1.c63aae6f6e918p-56},
                                           {0x1.dac670561bb4fp-2, 0x1.a2b7f222f65e2p-56},
                                           {0x1.1e00babdefeb4p-1, -0x1.928df287a668fp-58},
                                           {0x1.4978fa3269ee1p-1, 0x1.2419a87f2a458p-56},
                                           {0x1.700a7c5784634p-1, -0x1.8c34d25aadef6p-56},
                                           {0x1.921fb54442d18p-1, 0x1.1a62633145c07p-55}}};
  constexpr std::array<double, 7> series{-1.0 / 3,  1.0 / 5,  -1.0 / 7, 1.0 / 9,
                                         -1.0 / 11, 1.0 / 13, -1.0 / 15};
  const int eighths = static_cast<int>(8 * (a / b) + 0.5);
  const double c = 0.125 * eighths;
  // tan(angle - angle of c) = (a - c b) / (b + c a), in twice the digits
  const Pair cb = product(c, b), ca = product(c, a), over = difference(a, cb.high);
  const Pair under = sum_of_larger_and(b, ca.high);
  const double t = over.high / under.high;
  const Pair back = product(t, under.high);
  const double rest =
      (((over.high - back.high) - back.low) + (over.low - cb.low) - t * (under.low + ca.low)) /
      under.high;
  const Pair& start = of_eighth[static_cast<std::size_t>(eighths)];
  const Pair sum = sum_of_larger_and(start.high, t);
  const double t2 = t * t;
  const double tail = sum.low + (start.low + (rest + t * t2 * polynomial(series, t2)));
  return {sum.high, tail};
}

/// base + sign * angle
double sum(const Pair& base, double sign, const Pair& angle) {
  const Pair high = sum_of_larger_and(base.high, sign * angle.high);
  return high.high + (high.low + (base.low + sign * angle.low));
}

}  // namespace

double sin(double angle_rad) {
  const Turned t = turned(angle_rad);
  return sin_after(t.quarters, t.rest);
}

double cos(double angle_rad) {
  const Turned t = turned(angle_rad);
  return sin_after(t.quarters + 1, t.rest);
}

double atan2(double y, double x) {
  if (std::isnan(x) || std::isnan(y)) return nan;
  double a = std::abs(y), b = std::abs(x);
  const bool steep = a > b, backwards = std::signbit(x);
  if (steep) std::swap(a, b);
  if (b == infinity) a = a == infinity ? 1 : 0, b = 1;
  if (b == 0) b = 1;
  constexpr double large = 0x1p+500;  // squares and products of neither overflow nor vanish
  if (b > large) a /= large, a /= large, b /= large, b /= large;
  if (b < 1 / large) a *= large, b *= large;
  const Pair angle = atan_of_ratio(a, b);
  double out = angle.high + angle.low;
  if (steep) out = sum(half_pi, backwards ? 1 : -1, angle);
  if (backwards && !steep) out = sum(pi, -1, angle);
  return std::copysign(out, y);
}

double log(double x) {
  constexpr Pair log2{0x1.62e42fefa2000p-1, 0x1.9ef35793c7673p-41};  // 40 bits and 53
  constexpr std::array<double, 10> series{2.0 / 3,  2.0 / 5,  2.0 / 7,  2.0 / 9,  2.0 / 11,
                                          2.0 / 13, 2.0 / 15, 2.0 / 17, 2.0 / 19, 2.0 / 21};
  if (!(x > 0)) return x == 0 ? -infinity : nan;
  if (x == infinity) return x;
  int exponent;
  double f = std::frexp(x, &exponent);
  if (f < 0.5 * std::numbers::sqrt2) f *= 2, --exponent;
  f -= 1;
  // log(1 + f) = 2 atanh(s), written as f minus what is small beside it
  const double s = f / (2 + f), s2 = s * s, half = 0.5 * f * f;
  const double rest = s * (half + s2 * polynomial(series, s2));
  return exponent * log2.high - ((half - (rest + exponent * log2.low)) - f);
}

double exp(double x) {
  constexpr Pair log2{0x1.62e42fefa2000p-1, 0x1.9ef35793c7673p-41};
  constexpr std::array<double, 12> series{1.0 / 2,        1.0 / 6,         1.0 / 24,
                                          1.0 / 120,      1.0 / 720,       1.0 / 5040,
                                          1.0 / 40320,    1.0 / 362880,    1.0 / 3628800,
                                          1.0 / 39916800, 1.0 / 479001600, 1.0 / 6227020800.0};
  if (std::isnan(x)) return x;
  const double clamped = std::clamp(x, -1000.0, 1000.0);
  const double n = std::floor(clamped * (1 / std::numbers::ln2) + 0.5);
  const double high = clamped - n * log2.high;
  const Pair r = difference(high, n * log2.low);
  const double value = 1 + (r.high + (r.low + r.high * r.high * polynomial(series, r.high)));
  return std::ldexp(value, static_cast<int>(n));
}

}  // namespace throwcal::elementary
