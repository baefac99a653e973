// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <nettle/sha2.h>

#include <array>
#include <cstdint>
#include <string>
#include <string_view>

namespace throwcal {

using Sha256Digest = std::array<std::uint8_t, 32>;

/// FIPS 180-4, by nettle, of bytes that come in pieces.
class Sha256 {
 public:
  Sha256() { sha256_init(&context_); }
  void add(std::string_view piece);
  Sha256Digest digest() const;  ///< of all pieces so far

 private:
  sha256_ctx context_;
};

Sha256Digest sha256(std::string_view bytes);
std::string to_hex(const Sha256Digest& digest);  ///< 64 lower-case digits
std::string sha256_hex(std::string_view bytes);

}  // namespace throwcal
