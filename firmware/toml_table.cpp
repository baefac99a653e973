// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/toml_table.h"

#include <cstdio>

#include "capture/quotation.h"
#include "firmware/text_file.h"

namespace throwcal {
namespace {

std::string shown(const toml::node* node) {
  if (!node) return "nothing";
  if (const auto* text = node->as_string()) return in_quotes(text->get());
  if (const auto* whole = node->as_integer()) return std::to_string(whole->get());
  if (const auto* number = node->as_floating_point()) return shortest(number->get());
  if (const auto* yes = node->as_boolean()) return yes->get() ? "true" : "false";
  if (const auto* list = node->as_array()) return std::to_string(list->size()) + " values";
  return node->is_table() ? "a table" : "a date or time";
}

}  // namespace

std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    char escaped[8];
    std::snprintf(escaped, sizeof escaped, "\\u%04X", byte);
    if (c == '"' || c == '\\') out += '\\';
    out += byte < 0x20 || byte == 0x7F ? escaped : std::string(1, c);
  }
  return out + '"';
}

TomlTable::TomlTable(const toml::table& table, std::string file, std::string where)
    : table_(&table), file_(std::move(file)), where_(std::move(where)) {}

bool TomlTable::has(std::string_view key) const { return table_->contains(key); }

const toml::node* TomlTable::find(std::string_view key) {
  asked_.emplace(key);
  return table_->get(key);
}

std::string TomlTable::line_of(std::string_view key) const {
  const toml::node* node = table_->get(key);
  return std::to_string((node ? node->source() : table_->source()).begin.line);
}

std::string TomlTable::at(std::string_view key) const {
  return file_ + ":" + line_of(key) + ": " + where_ + " " + std::string(key);
}

void TomlTable::reject(std::string_view key, const std::string& expected) const {
  throw InputError(at(key) + " must be " + expected + ", got " + shown(table_->get(key)));
}

void TomlTable::missing(std::string_view key, const std::string& expected) const {
  throw InputError(at(key) + " is missing; expected " + expected);
}

std::optional<double> TomlTable::number(std::string_view key, const NumberRange& range) {
  const toml::node* node = find(key);
  if (!node) return {};
  const std::optional<double> value = node->is_number() ? node->value<double>() : std::nullopt;
  if (!value || !range.holds(*value)) reject(key, range.text);
  return value;
}

double TomlTable::required_number(std::string_view key, const NumberRange& range) {
  const auto value = number(key, range);
  if (!value) missing(key, range.text);
  return *value;
}

std::optional<std::int64_t> TomlTable::integer(std::string_view key, std::int64_t low,
                                               std::int64_t high) {
  const toml::node* node = find(key);
  if (!node) return {};
  const auto value = node->is_integer() ? node->value<std::int64_t>() : std::nullopt;
  if (!value || *value < low || *value > high)
    reject(key, "a whole number from " + std::to_string(low) + " to " + std::to_string(high));
  return value;
}

std::optional<bool> TomlTable::boolean(std::string_view key) {
  const toml::node* node = find(key);
  if (!node) return {};
  if (!node->is_boolean()) reject(key, "true or false");
  return node->value<bool>();
}

std::int64_t TomlTable::required_integer(std::string_view key, std::int64_t low,
                                         std::int64_t high) {
  const auto value = integer(key, low, high);
  if (!value)
    missing(key, "a whole number from " + std::to_string(low) + " to " + std::to_string(high));
  return *value;
}

std::optional<std::string> TomlTable::text(std::string_view key) {
  const toml::node* node = find(key);
  if (!node) return {};
  if (!node->is_string()) reject(key, "a text in quotes");
  return node->value<std::string>();
}

std::optional<std::string> TomlTable::choice(std::string_view key,
                                             const std::vector<std::string>& words) {
  const toml::node* node = find(key);
  if (!node) return {};
  const auto value = node->is_string() ? node->value<std::string>() : std::nullopt;
  std::string expected;
  for (std::size_t i = 0; i < words.size(); ++i) {
    if (value == words[i]) return value;
    expected += (i == 0 ? "" : i + 1 == words.size() ? " or " : ", ") + ('"' + words[i] + '"');
  }
  reject(key, expected);
}

std::optional<std::vector<double>> TomlTable::numbers(std::string_view key,
                                                      const NumberRange& each) {
  const toml::node* node = find(key);
  if (!node) return {};
  const toml::array* list = node->as_array();
  if (!list) reject(key, "a list of numbers");
  std::vector<double> out;
  for (const toml::node& item : *list) {
    const auto value = item.is_number() ? item.value<double>() : std::nullopt;
    if (!value || !each.holds(*value))
      throw InputError(at(key) + " must be a list, each of it " + each.text + ", got " +
                       shown(&item));
    out.push_back(*value);
  }
  return out;
}

std::optional<std::vector<std::string>> TomlTable::texts(std::string_view key) {
  const toml::node* node = find(key);
  if (!node) return {};
  const toml::array* list = node->as_array();
  if (!list || (!list->empty() && !list->is_homogeneous(toml::node_type::string)))
    reject(key, "a list of texts");
  std::vector<std::string> out;
  for (const toml::node& item : *list) out.push_back(*item.value<std::string>());
  return out;
}

std::optional<std::vector<std::string>> TomlTable::text_or_texts(std::string_view key) {
  const toml::node* node = find(key);
  if (node && node->is_string()) return std::vector<std::string>{*node->value<std::string>()};
  return texts(key);
}

std::vector<std::string> TomlTable::unread() const {
  std::vector<std::string> out;
  for (const auto& [key, node] : *table_)
    if (!asked_.contains(std::string(key.str())))
      out.push_back(file_ + ":" + std::to_string(node.source().begin.line) + ": " + where_ + " " +
                    printable(key.str()) + " is not a known key");
  return out;
}

}  // namespace throwcal
