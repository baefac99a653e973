// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/config_changes.h"

#include <map>
#include <sstream>

#include "capture/quotation.h"
#include "firmware/toml_table.h"

namespace throwcal {
namespace {

using Values = std::map<std::string, std::string>;

void add(const std::string& where, const toml::table& table, Values& out) {
  for (const auto& [key, node] : table) {
    std::ostringstream text;
    node.visit([&](const auto& value) { text << value; });
    out[where + " " + printable(key.str())] = text.str();
  }
}

/// Each key with its value as text.
Values values_of(std::string_view toml) {
  Values out;
  const toml::table document = toml::parse(toml);
  for (const auto& [key, node] : document) {
    const std::string name = printable(key.str());
    if (const auto* table = node.as_table()) add("[" + name + "]", *table, out);
    const auto* list = node.as_array();
    for (std::size_t i = 0; list && i < list->size(); ++i)
      if (const auto* table = list->get_as<toml::table>(i))
        add("[[" + name + "]] " + std::to_string(i + 1), *table, out);
  }
  return out;
}

}  // namespace

std::vector<std::string> config_changes(std::string_view old_toml, std::string_view new_toml) {
  const Values before = values_of(old_toml), after = values_of(new_toml);
  std::vector<std::string> out;
  Values all = before;
  all.insert(after.begin(), after.end());
  for (const auto& [key, value] : all) {
    const auto old = before.find(key), now = after.find(key);
    if (old == before.end() || now == after.end() || old->second != now->second) out.push_back(key);
  }
  return out;
}

Taken taken(std::string_view change) {
  if (change.starts_with("[button] ") || change.starts_with("[light] ") ||
      change == "[daemon] unit")
    return Taken::at_once;
  if (change.starts_with("[target] ") || change == "[daemon] pre_trigger_s")
    return Taken::between_sessions;
  return Taken::at_restart;
}

}  // namespace throwcal
