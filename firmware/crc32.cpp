// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/crc32.h"

#include <array>

namespace throwcal {
namespace {

constexpr std::uint32_t polynomial = 0xEDB88320;  // 0x04C11DB7, lowest bit first

constexpr std::array<std::uint32_t, 256> table = [] {
  std::array<std::uint32_t, 256> out{};
  for (std::uint32_t byte = 0; byte < out.size(); ++byte) {
    std::uint32_t rest = byte;
    for (int bit = 0; bit < 8; ++bit) rest = rest >> 1 ^ (rest & 1 ? polynomial : 0);
    out[byte] = rest;
  }
  return out;
}();

}  // namespace

std::uint32_t crc32(std::string_view bytes) {
  std::uint32_t rest = ~std::uint32_t{0};
  for (const char c : bytes)
    rest = table[(rest ^ static_cast<unsigned char>(c)) & 0xFF] ^ rest >> 8;
  return ~rest;
}

}  // namespace throwcal
