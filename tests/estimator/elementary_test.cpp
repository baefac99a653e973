// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/elementary.h"

#include <gtest/gtest.h>

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <numbers>
#include <random>

namespace throwcal {
namespace {

constexpr double inf = std::numeric_limits<double>::infinity();

/// Numbers that are the same everywhere: the engine's are fixed by the standard, the rest is exact.
class Sweep {
 public:
  double between(double low, double high) {
    return low + std::ldexp(static_cast<double>(engine_() >> 11), -53) * (high - low);
  }
  /// Of either sign and any size from 2^low to 2^high.
  double sized(int low, int high) {
    const int exponent = low + static_cast<int>(engine_() % static_cast<unsigned>(high - low));
    const double sign = engine_() & 1 ? 1 : -1;
    return sign * std::ldexp(between(1, 2), exponent);
  }

 private:
  std::mt19937_64 engine_{7};
};

/// The greatest error in units of the last place.
double worst_ulp(const std::function<double(Sweep&, long double&)>& value_and_truth) {
  Sweep sweep;
  double worst = 0.0;
  for (int i = 0; i < 200'000; ++i) {
    long double truth;
    const double value = value_and_truth(sweep, truth);
    int exponent;
    std::frexp(static_cast<double>(truth), &exponent);
    const double error =
        static_cast<double>(std::ldexp(std::abs(value - truth), std::min(53 - exponent, 1074)));
    if (!(error <= worst)) worst = error;
  }
  return worst;
}

TEST(Elementary, SineAndCosineAreRightToAUnitInTheLastPlace) {
  for (const double range : {1e-8, 0.8, 4.0, 100.0, 3000.0}) {
    EXPECT_LT(worst_ulp([&](Sweep& sweep, long double& truth) {
                const double x = sweep.between(-range, range);
                truth = std::sin(static_cast<long double>(x));
                return elementary::sin(x);
              }),
              0.85)
        << range;
    EXPECT_LT(worst_ulp([&](Sweep& sweep, long double& truth) {
                const double x = sweep.between(-range, range);
                truth = std::cos(static_cast<long double>(x));
                return elementary::cos(x);
              }),
              0.85)
        << range;
  }
}

TEST(Elementary, SineIsRightBesideItsZeros) {
  // pi's digits after its double's: what is left of sin there
  EXPECT_EQ(elementary::sin(std::numbers::pi), 0x1.1a62633145c07p-53);
  EXPECT_EQ(elementary::cos(0.5 * std::numbers::pi), 0x1.1a62633145c07p-54);
  for (int k = 1; k < 1900; ++k) {
    const double x = k * (0.5 * std::numbers::pi);
    const long double truth =
        k % 2 ? std::cos(static_cast<long double>(x)) : std::sin(static_cast<long double>(x));
    const double value = k % 2 ? elementary::cos(x) : elementary::sin(x);
    EXPECT_LT(std::abs(value - truth), 1.2e-16 * std::abs(truth)) << k;
  }
}

TEST(Elementary, BeyondThreeThousandTheArgumentsOwnLastPlaceCounts) {
  Sweep sweep;
  for (int i = 0; i < 10'000; ++i) {
    const double x = sweep.sized(12, 40);
    const double unit = std::nextafter(std::abs(x), inf) - std::abs(x);
    EXPECT_NEAR(elementary::sin(x), static_cast<double>(std::sin(static_cast<long double>(x))),
                unit);
  }
  for (const double x : {inf, -inf, std::nan("")}) {
    EXPECT_TRUE(std::isnan(elementary::sin(x)));
    EXPECT_TRUE(std::isnan(elementary::cos(x)));
  }
}

TEST(Elementary, TheArcTangentIsRightToHalfAUnit) {
  for (const int size : {1, 30, 400, 900})
    EXPECT_LT(worst_ulp([&](Sweep& sweep, long double& truth) {
                const double y = sweep.sized(-size, size), x = sweep.sized(-std::min(size, 20), 20);
                truth = std::atan2(static_cast<long double>(y), static_cast<long double>(x));
                return elementary::atan2(y, x);
              }),
              0.51)
        << size;
}

TEST(Elementary, TheArcTangentOfZerosAndInfinitiesIsTheLibrarys) {
  const std::array<double, 11> values{0.0,    -0.0,  1.0,    -1.0,   inf,         -inf,
                                      5e-324, 1e308, -1e308, 1e-310, std::nan("")};
  for (const double y : values)
    for (const double x : values) {
      const double ours = elementary::atan2(y, x), library = std::atan2(y, x);
      if (std::isnan(library)) {
        EXPECT_TRUE(std::isnan(ours));
        continue;
      }
      EXPECT_EQ(ours, library) << y << " " << x;
      EXPECT_EQ(std::signbit(ours), std::signbit(library)) << y << " " << x;
    }
}

TEST(Elementary, LogarithmAndExponentialAreRightToAUnitInTheLastPlace) {
  for (const double range : {0.01, 0.5, 5.0, 700.0}) {
    EXPECT_LT(worst_ulp([&](Sweep& sweep, long double& truth) {
                const double x = std::exp2(sweep.between(-range, range));
                truth = std::log(static_cast<long double>(x));
                return elementary::log(x);
              }),
              0.9)
        << range;
    EXPECT_LT(worst_ulp([&](Sweep& sweep, long double& truth) {
                const double x = sweep.between(-range, range);
                truth = std::exp(static_cast<long double>(x));
                return elementary::exp(x);
              }),
              0.9)
        << range;
  }
}

TEST(Elementary, LogarithmAndExponentialKnowTheirEnds) {
  EXPECT_EQ(elementary::log(1.0), 0.0);
  EXPECT_EQ(elementary::log(0.0), -inf);
  EXPECT_EQ(elementary::log(inf), inf);
  EXPECT_NEAR(elementary::log(5e-324), -744.44007192138126, 1e-12);
  EXPECT_TRUE(std::isnan(elementary::log(-1.0)) && std::isnan(elementary::log(std::nan(""))));
  EXPECT_EQ(elementary::exp(0.0), 1.0);
  EXPECT_EQ(elementary::exp(710.0), inf);
  EXPECT_EQ(elementary::exp(inf), inf);
  EXPECT_EQ(elementary::exp(-745.0), 5e-324);
  EXPECT_EQ(elementary::exp(-inf), 0.0);
  EXPECT_TRUE(std::isnan(elementary::exp(std::nan(""))));
}

/// FNV-1a over the bits of what the function answers.
std::uint64_t checksum(const std::function<double(Sweep&)>& answer) {
  Sweep sweep;
  std::uint64_t sum = 0xcbf29ce484222325;
  for (int i = 0; i < 100'000; ++i) {
    const auto bits = std::bit_cast<std::uint64_t>(answer(sweep));
    for (int byte = 0; byte < 8; ++byte) sum = (sum ^ (bits >> (8 * byte) & 0xff)) * 0x100000001b3;
  }
  return sum;
}

// The same constants on every machine, compiler and C library: that is what these functions are
// for.
TEST(Elementary, EveryMachineGivesTheseBits) {
  EXPECT_EQ(checksum([](Sweep& s) { return elementary::sin(s.sized(-20, 30)); }),
            0x318fe4285dd6625f);
  EXPECT_EQ(checksum([](Sweep& s) { return elementary::cos(s.sized(-20, 30)); }),
            0x138a1c138338df73);
  EXPECT_EQ(checksum([](Sweep& s) {
              const double y = s.sized(-30, 30);
              return elementary::atan2(y, s.sized(-30, 30));
            }),
            0x634587f4727cd1ba);
  EXPECT_EQ(checksum([](Sweep& s) { return elementary::log(std::abs(s.sized(-1000, 1000))); }),
            0x3883ac03cda240ae);
  EXPECT_EQ(checksum([](Sweep& s) { return elementary::exp(s.sized(-20, 9)); }),
            0x2b54d9aa32da0ef0);
}

}  // namespace
}  // namespace throwcal
