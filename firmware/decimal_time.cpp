// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/decimal_time.h"

#include <charconv>
#include <cstdint>
#include <limits>

namespace throwcal {
namespace {

/// A decimal number taken apart: 0.digits x 10^point, so that no binary fraction comes in between.
struct Decimal {
  bool negative = false;
  std::string digits;
  int point = 0;
};

std::optional<Decimal> take_apart(std::string_view text) {
  Decimal out;
  if (text.starts_with('-') || text.starts_with('+')) {
    out.negative = text.front() == '-';
    text.remove_prefix(1);
  }
  bool after_point = false, any_digit = false;
  std::size_t i = 0;
  for (; i < text.size(); ++i) {
    const char c = text[i];
    if (c == '.' && !after_point) {
      after_point = true;
    } else if (c >= '0' && c <= '9') {
      any_digit = true;
      if (out.digits.empty() && c == '0') {
        if (after_point) --out.point;
        continue;  // a leading zero
      }
      out.digits += c;
      if (!after_point) ++out.point;
    } else {
      break;
    }
  }
  if (!any_digit) return {};
  if (i == text.size()) return out;
  if (text[i] != 'e' && text[i] != 'E') return {};
  std::string_view power = text.substr(i + 1);
  if (power.starts_with('+')) power.remove_prefix(1);
  int exponent = 0;
  const auto [end, error] = std::from_chars(power.data(), power.data() + power.size(), exponent);
  if (error != std::errc{} || end != power.data() + power.size()) return {};
  if (exponent < -1000 || exponent > 1000) return {};
  out.point += exponent;
  return out;
}

}  // namespace

std::optional<HostTime> parse_time(std::string_view decimal_seconds) {
  const auto decimal = take_apart(decimal_seconds);
  if (!decimal) return {};
  if (decimal->digits.empty()) return HostTime{};
  const int size = static_cast<int>(decimal->digits.size());
  const int count = decimal->point + 9;  // digits before the nanoseconds' point
  if (count > 19) return {};
  std::uint64_t nanoseconds = 0;  // 19 digits fit
  for (int i = 0; i < count; ++i)
    nanoseconds =
        10 * nanoseconds + static_cast<std::uint64_t>(i < size ? decimal->digits[i] - '0' : 0);
  const bool round_up = count >= 0 && count < size && decimal->digits[count] >= '5';
  nanoseconds += round_up;
  if (nanoseconds > std::numeric_limits<std::int64_t>::max()) return {};
  const auto whole = static_cast<std::int64_t>(nanoseconds);
  return HostTime(HostClock::duration(decimal->negative ? -whole : whole));
}

std::string to_decimal_seconds(HostTime time) {
  const std::int64_t count = time.time_since_epoch().count();
  const std::uint64_t size = count < 0 ? -static_cast<std::uint64_t>(count) : count;
  std::string fraction = std::to_string(size % 1'000'000'000);
  fraction.insert(0, 9 - fraction.size(), '0');
  return (count < 0 ? "-" : "") + std::to_string(size / 1'000'000'000) + "." + fraction;
}

}  // namespace throwcal
