// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/tar_file.h"

#include <cassert>
#include <numeric>

namespace throwcal {
namespace {

constexpr std::size_t block_bytes = 512, end_blocks = 2;
constexpr std::size_t checksum_at = 148, checksum_digits = 6;

/// A number in octal, with leading zeros and a NUL behind it.
void put_octal(std::string& header, std::size_t at, std::size_t digits, std::uint64_t value) {
  for (std::size_t i = digits; i-- > 0; value /= 8)
    header[at + i] = static_cast<char>('0' + value % 8);
  assert(value == 0);
}

std::string header_of(std::string_view name, std::size_t size, std::uint64_t time_s) {
  std::string header(block_bytes, '\0');
  const auto put = [&](std::size_t at, std::string_view text) {
    header.replace(at, text.size(), text);
  };
  put(0, name);
  put_octal(header, 100, 7, 0644);  // mode; owner and group are 0
  put_octal(header, 108, 7, 0);
  put_octal(header, 116, 7, 0);
  put_octal(header, 124, 11, size);
  put_octal(header, 136, 11, time_s);
  put(checksum_at, "        ");
  put(156, "0");  // a plain file
  put(257, std::string_view("ustar\00000", 8));
  const auto sum = std::accumulate(
      header.begin(), header.end(), std::uint64_t{0},
      [](std::uint64_t all, char c) { return all + static_cast<unsigned char>(c); });
  put_octal(header, checksum_at, checksum_digits, sum);
  header[checksum_at + checksum_digits] = '\0';
  return header;
}

}  // namespace

void TarFile::add(std::string_view name, std::string_view content) {
  assert(!name.empty() && name.size() <= 100);
  const auto time = std::chrono::duration_cast<std::chrono::seconds>(modified_.time_since_epoch());
  bytes_ += header_of(name, content.size(), static_cast<std::uint64_t>(time.count()));
  bytes_ += content;
  bytes_.resize((bytes_.size() + block_bytes - 1) / block_bytes * block_bytes);
}

std::string TarFile::finish() && {
  bytes_.resize(bytes_.size() + end_blocks * block_bytes);
  return std::move(bytes_);
}

}  // namespace throwcal
