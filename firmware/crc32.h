// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <cstdint>
#include <string_view>

namespace throwcal {

/// That of Ethernet, zip and Python's zlib.crc32.
std::uint32_t crc32(std::string_view bytes);

}  // namespace throwcal
