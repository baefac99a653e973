// SPDX-License-Identifier: BSD-3-Clause
#include "capture/frame_times.h"

#include <algorithm>
#include <cctype>
#include <fstream>
#include <iterator>
#include <optional>
#include <stdexcept>

#include "capture/quotation.h"

namespace throwcal {
namespace {

constexpr std::string_view spaces = " \t\r";
constexpr std::int64_t most_ms =
    4'000'000'000'000;  ///< 126 years: the difference of two such times fits 64 bits of nanoseconds
constexpr std::size_t ms_digits = 13;
constexpr int ns_digits = 6;  ///< of a millisecond

std::string_view trimmed(std::string_view text) {
  const auto first = text.find_first_not_of(spaces);
  if (first == text.npos) return {};
  return text.substr(first, text.find_last_not_of(spaces) - first + 1);
}

bool are_digits(std::string_view text) {
  return std::ranges::all_of(text, [](unsigned char c) { return std::isdigit(c); });
}

/// Of at most 18 digits.
std::int64_t value_of(std::string_view digits) {
  std::int64_t value = 0;
  for (const char c : digits) value = 10 * value + (c - '0');
  return value;
}

/// Decimal milliseconds to nanoseconds, digit by digit: a double would round after a few months.
std::optional<std::int64_t> nanoseconds_of(std::string_view text) {
  const bool is_negative = text.starts_with('-');
  if (is_negative || text.starts_with('+')) text.remove_prefix(1);
  const auto dot = text.find('.');
  const std::string_view whole = text.substr(0, dot);
  std::string_view part = dot == text.npos ? std::string_view() : text.substr(dot + 1);
  if ((whole.empty() && part.empty()) || whole.size() > ms_digits || !are_digits(whole) ||
      !are_digits(part))
    return std::nullopt;
  const bool rounds_up = part.size() > ns_digits && part[ns_digits] >= '5';
  std::string fraction(part.substr(0, ns_digits));
  fraction.resize(ns_digits, '0');
  const std::int64_t ms = value_of(whole);
  if (ms > most_ms) return std::nullopt;
  const std::int64_t sum = ms * 1'000'000 + value_of(fraction) + rounds_up;
  return is_negative ? -sum : sum;
}

}  // namespace

std::vector<HostTime> read_frame_times(const std::string& path) {
  std::ifstream file(path);
  if (!file) throw std::runtime_error(path + ": cannot be opened; frame times were expected there");
  const std::string text(std::istreambuf_iterator<char>(file), {});
  if (file.bad()) throw std::runtime_error(path + ": reading failed");
  return parse_frame_times(text, path);
}

std::vector<HostTime> parse_frame_times(std::string_view text, const std::string& name) {
  std::vector<HostTime> times;
  for (int number = 1; !text.empty(); ++number) {
    const std::string_view line = text.substr(0, text.find('\n'));
    text.remove_prefix(std::min(line.size() + 1, text.size()));
    const std::string_view entry = trimmed(line);
    if (entry.empty() || entry.starts_with('#')) continue;
    const std::string place = name + ", line " + std::to_string(number) + ": ";
    const auto ns = nanoseconds_of(entry);
    if (!ns)
      throw std::runtime_error(place + in_quotes(entry) +
                               " is no time; expected milliseconds such as 16.683333");
    const HostTime time{HostClock::duration(*ns)};
    if (!times.empty() && time <= times.back())
      throw std::runtime_error(place + printable(entry) +
                               " ms is not after the frame before it; times must ascend");
    times.push_back(time);
  }
  return times;
}

}  // namespace throwcal
