// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <optional>
#include <string>
#include <string_view>

namespace throwcal {

/// RFC 4648, by nettle.
std::string to_base64(std::string_view bytes);
std::optional<std::string> from_base64(std::string_view text);  ///< nothing where it is none

}  // namespace throwcal
