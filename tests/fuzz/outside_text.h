// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <stdexcept>
#include <string_view>

namespace throwcal {

/// What must hold for every input; where it does not, the fuzzer keeps the input.
inline void require(bool holds, const char* what) {
  if (holds) return;
  std::fprintf(stderr, "does not hold: %s\n", what);
  std::abort();
}

/// The fuzzer's bytes as the text of a file.
inline std::string_view text_of(const std::uint8_t* data, std::size_t size) {
  return {reinterpret_cast<const char*>(data), size};
}

/// Reads something from outside: it may be refused, by an Error whose message is one short line.
template <class Error, class Read>
bool is_accepted(Read&& read) {
  try {
    read();
    return true;
  } catch (const Error& error) {
    const std::string_view message = error.what();
    require(!message.empty() && message.size() < 1000, "a message is short");
    for (const char c : message) require(c >= 0x20 && c < 0x7F, "a message is one printable line");
    return false;
  }
}

}  // namespace throwcal

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);
