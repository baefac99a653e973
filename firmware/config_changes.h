// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <string>
#include <string_view>
#include <vector>

namespace throwcal {

/// What differs between two rig files that were read without an error, in order: "[daemon] listen",
/// "[[camera]] 2 fx_px". Comments, layout and order of keys are no difference.
std::vector<std::string> config_changes(std::string_view old_toml, std::string_view new_toml);

/// When a running box can take a change.
enum class Taken { at_once, between_sessions, at_restart };
Taken taken(std::string_view change);

}  // namespace throwcal
