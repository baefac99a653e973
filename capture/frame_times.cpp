// SPDX-License-Identifier: BSD-3-Clause
#include "capture/frame_times.h"

#include <cctype>
#include <fstream>
#include <optional>
#include <stdexcept>
#include <string_view>

namespace throwcal {
namespace {

constexpr std::string_view spaces = " \t\r";
constexpr std::int64_t most_ms =
    9'000'000'000'000;  ///< 285 years: in nanoseconds that fits 64 bits
constexpr std::size_t ms_digits = 13;
constexpr int ns_digits = 6;  ///< of a millisecond

std::string_view trimmed(std::string_view text) {
  const auto first = text.find_first_not_of(spaces);
  if (first == text.npos) return {};
  return text.substr(first, text.find_last_not_of(spaces) - first + 1);
}

std::optional<std::int64_t> digits(std::string_view text) {
  std::int64_t value = 0;
  for (const char c : text) {
    if (!std::isdigit(static_cast<unsigned char>(c))) return std::nullopt;
    value = 10 * value + (c - '0');
  }
  return value;
}

/// Decimal milliseconds to nanoseconds, digit by digit: a double would round after a few months.
std::optional<std::int64_t> nanoseconds_of(std::string_view text) {
  const bool is_negative = text.starts_with('-');
  if (is_negative || text.starts_with('+')) text.remove_prefix(1);
  const auto dot = text.find('.');
  const std::string_view whole = text.substr(0, dot);
  std::string_view part = dot == text.npos ? std::string_view() : text.substr(dot + 1);
  if ((whole.empty() && part.empty()) || whole.size() > ms_digits || !digits(part))
    return std::nullopt;
  const bool rounds_up = part.size() > ns_digits && part[ns_digits] >= '5';
  std::string fraction(part.substr(0, ns_digits));
  fraction.resize(ns_digits, '0');
  const auto ms = digits(whole), ns = digits(fraction);
  if (!ms || !ns || *ms > most_ms) return std::nullopt;
  const std::int64_t sum = *ms * 1'000'000 + *ns + rounds_up;
  return is_negative ? -sum : sum;
}

}  // namespace

std::vector<HostTime> read_frame_times(const std::string& path) {
  std::ifstream file(path);
  if (!file) throw std::runtime_error(path + ": cannot be opened; frame times were expected there");
  std::vector<HostTime> times;
  std::string line;
  for (int number = 1; std::getline(file, line); ++number) {
    const std::string_view text = trimmed(line);
    if (text.empty() || text.starts_with('#')) continue;
    const std::string place = path + ", line " + std::to_string(number) + ": ";
    const auto ns = nanoseconds_of(text);
    if (!ns)
      throw std::runtime_error(place + "\"" + std::string(text.substr(0, 40)) +
                               "\" is no time; expected milliseconds such as 16.683333");
    const HostTime time{HostClock::duration(*ns)};
    if (!times.empty() && time <= times.back())
      throw std::runtime_error(place + std::string(text) +
                               " ms is not after the frame before it; times must ascend");
    times.push_back(time);
  }
  if (file.bad()) throw std::runtime_error(path + ": reading failed");
  return times;
}

}  // namespace throwcal
