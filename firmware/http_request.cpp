// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/http_request.h"

#include <algorithm>
#include <charconv>

namespace throwcal {
namespace {

constexpr std::string_view blanks = " \t";

std::string_view trimmed(std::string_view text) {
  const std::size_t first = text.find_first_not_of(blanks);
  if (first == text.npos) return {};
  return text.substr(first, text.find_last_not_of(blanks) - first + 1);
}

char lower(char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; }

bool is_same_word(std::string_view a, std::string_view b) {
  return std::ranges::equal(a, b, {}, lower, lower);
}

/// The byte that "%2E" at `at` stands for.
std::optional<char> encoded_byte(std::string_view text, std::size_t at) {
  unsigned byte = 0;
  const char* digits = text.data() + at + 1;
  if (at + 3 > text.size()) return {};
  const auto [end, error] = std::from_chars(digits, digits + 2, byte, 16);
  if (error != std::errc{} || end != digits + 2) return {};
  return static_cast<char>(byte);
}

std::optional<std::string> decoded(std::string_view segment) {
  std::string out;
  for (std::size_t i = 0; i < segment.size(); ++i) {
    char c = segment[i];
    if (c == '%') {
      const auto byte = encoded_byte(segment, i);
      if (!byte || *byte == '/' || *byte == '%') return {};
      c = *byte;
      i += 2;
    }
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7F) return {};
    out += c;
  }
  return out;
}

}  // namespace

std::optional<std::vector<std::string>> path_segments(std::string_view target) {
  std::string_view path = target.substr(0, target.find('?'));
  if (!path.starts_with('/')) return {};
  path.remove_prefix(1);
  std::vector<std::string> out;
  while (!path.empty()) {
    const std::size_t end = std::min(path.find('/'), path.size());
    auto segment = decoded(path.substr(0, end));
    if (!segment || segment->empty() || end + 1 == path.size()) return {};
    out.push_back(*std::move(segment));
    path.remove_prefix(std::min(end + 1, path.size()));
  }
  return out;
}

std::optional<std::string> bearer_token(std::string_view authorization) {
  const std::string_view text = trimmed(authorization);
  const std::size_t end = text.find_first_of(blanks);
  if (end == text.npos || !is_same_word(text.substr(0, end), "bearer")) return {};
  return std::string(trimmed(text.substr(end)));
}

bool names_tag(std::string_view if_none_match, std::string_view tag) {
  std::string_view rest = trimmed(if_none_match);
  if (rest == "*") return true;
  while (!rest.empty()) {
    const std::size_t end = std::min(rest.find(','), rest.size());
    std::string_view one = trimmed(rest.substr(0, end));
    if (one.starts_with("W/")) one.remove_prefix(2);
    if (one == tag) return true;
    rest.remove_prefix(std::min(end + 1, rest.size()));
  }
  return false;
}

bool is_own_page(std::string_view origin, std::string_view host) {
  const std::size_t scheme = origin.find("://");
  return scheme != origin.npos && is_same_word(origin.substr(scheme + 3), host);
}

}  // namespace throwcal
