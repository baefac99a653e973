// SPDX-License-Identifier: BSD-3-Clause
#pragma once
// Nothing of a file from outside is asserted on: toml++ 3.3 does on "[.a]", and tells the same
// fault properly where it may go on.
#define TOML_ASSERT(condition) static_cast<void>(0)
#include <toml++/toml.h>

#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "firmware/input_error.h"
#include "firmware/number_range.h"

namespace throwcal {

/// One table of a TOML file, read key by key. Every value that is not what was asked for throws
/// InputError with file and line; what nobody asked for is told by unread().
class TomlTable {
 public:
  /// `where` names the table in messages ("[ball]", `camera "north":`); `file` prefixes the line.
  TomlTable(const toml::table& table, std::string file, std::string where);

  bool has(std::string_view key) const;
  std::optional<double> number(std::string_view key, const NumberRange& range);
  double required_number(std::string_view key, const NumberRange& range);
  std::optional<std::int64_t> integer(std::string_view key, std::int64_t low, std::int64_t high);
  std::int64_t required_integer(std::string_view key, std::int64_t low, std::int64_t high);
  std::optional<bool> boolean(std::string_view key);
  std::optional<std::string> text(std::string_view key);
  /// One of a few words; the expectation names them all.
  std::optional<std::string> choice(std::string_view key, const std::vector<std::string>& words);
  std::optional<std::vector<double>> numbers(std::string_view key, const NumberRange& each);
  std::optional<std::vector<std::string>> texts(std::string_view key);
  /// One text, or a list of them.
  std::optional<std::vector<std::string>> text_or_texts(std::string_view key);

  [[noreturn]] void reject(std::string_view key, const std::string& expected) const;
  [[noreturn]] void missing(std::string_view key, const std::string& expected) const;
  /// "rig.toml:7: [site] gravty_mps2 is not a known key", one a key that was never asked for.
  std::vector<std::string> unread() const;
  void rename(std::string where) { where_ = std::move(where); }
  std::string at(std::string_view key) const;  ///< "rig.toml:12: [site] key"

 private:
  const toml::node* find(std::string_view key);
  std::string line_of(std::string_view key) const;

  const toml::table* table_;
  std::string file_, where_;
  std::set<std::string, std::less<>> asked_;
};

/// A TOML basic string.
std::string quoted(const std::string& text);

}  // namespace throwcal
