// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/access.h"

#include <fcntl.h>
#include <nettle/memops.h>
#include <sys/random.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

#include "firmware/input_error.h"
#include "firmware/sha256.h"
#include "firmware/text_file.h"

namespace throwcal {
namespace {

constexpr std::size_t shortest_token = 8, longest_token = 128, random_bytes = 16;

void make(const std::filesystem::path& file) { write_text_file(file, new_token() + "\n", 0640); }

bool is_printable(char c) { return c > ' ' && c <= '~'; }

}  // namespace

bool Access::knows(std::string_view token) const {
  // Of digests, so that not even the length is told by the time it takes.
  const auto given = sha256(token), ours = sha256(token_);
  return memeql_sec(given.data(), ours.data(), ours.size()) != 0;
}

std::uint32_t Access::short_key() const {
  const auto digest = sha256(token_);
  return std::uint32_t{digest[0]} << 24 | std::uint32_t{digest[1]} << 16 |
         std::uint32_t{digest[2]} << 8 | digest[3];
}

std::string new_token() {
  std::array<char, random_bytes> seed{};
  if (getrandom(seed.data(), seed.size(), 0) != static_cast<ssize_t>(seed.size()))
    throw InputError(std::string("no random numbers for a token: ") + std::strerror(errno));
  return sha256_hex({seed.data(), seed.size()}).substr(0, 2 * random_bytes);
}

std::string token_in(const std::filesystem::path& file) {
  if (std::error_code error; !std::filesystem::exists(file, error)) make(file);
  const std::string text = read_text_file(file);
  std::string token = text.substr(0, text.find('\n'));
  if (token.ends_with('\r')) token.pop_back();
  if (token.size() < shortest_token || token.size() > longest_token ||
      !std::ranges::all_of(token, is_printable))
    throw InputError(
        file.string() + ":1: expected a token of " + std::to_string(shortest_token) + " to " +
        std::to_string(longest_token) +
        " printable characters without a space; remove the file and a new one is made");
  return token;
}

std::string new_token_in(const std::filesystem::path& file) {
  make(file);
  return token_in(file);
}

}  // namespace throwcal
