// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <array>
#include <cstdint>

namespace throwcal {

/// sRGB: red, green, blue, 0 to 255 each.
using Colour = std::array<std::uint8_t, 3>;

}  // namespace throwcal
