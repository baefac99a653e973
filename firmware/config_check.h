// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <filesystem>
#include <string>

#include "firmware/config.h"

namespace throwcal {

/// What the box understood of its configuration, a few lines. Throws InputError where the box
/// could not start with it, as far as that can be said without opening anything.
std::string summary(const Config& config, const std::filesystem::path& state_dir);

}  // namespace throwcal
