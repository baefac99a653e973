// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <array>
#include <cstdint>
#include <string>
#include <string_view>

namespace throwcal {

/// FIPS 180-4, by nettle.
std::array<std::uint8_t, 32> sha256(std::string_view bytes);
std::string sha256_hex(std::string_view bytes);  ///< 64 lower-case digits

}  // namespace throwcal
