// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/sha256.h"

namespace throwcal {

void Sha256::add(std::string_view piece) {
  sha256_update(&context_, piece.size(), reinterpret_cast<const std::uint8_t*>(piece.data()));
}

Sha256Digest Sha256::digest() const {
  sha256_ctx end = context_;  // nettle begins anew with the one that it is asked of
  Sha256Digest out{};
  sha256_digest(&end, out.size(), out.data());
  return out;
}

Sha256Digest sha256(std::string_view bytes) {
  Sha256 all;
  all.add(bytes);
  return all.digest();
}

std::string to_hex(const Sha256Digest& digest) {
  constexpr std::string_view digits = "0123456789abcdef";
  std::string out;
  for (const std::uint8_t byte : digest) {
    out += digits[byte >> 4];
    out += digits[byte & 15];
  }
  return out;
}

std::string sha256_hex(std::string_view bytes) { return to_hex(sha256(bytes)); }

}  // namespace throwcal
