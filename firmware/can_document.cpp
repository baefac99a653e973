// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/can_document.h"

#include <algorithm>
#include <optional>

#include "firmware/crc32.h"

namespace throwcal {
namespace {

constexpr std::uint8_t version = 1;

void append(std::string& out, std::uint32_t value, int bytes) {
  for (int i = 0; i < bytes; ++i) out += static_cast<char>(value >> 8 * i & 0xFF);
}

std::uint32_t number_at(std::string_view bytes, std::size_t place, std::size_t count) {
  std::uint32_t out = 0;
  for (std::size_t i = 0; i < count; ++i)
    out |= std::uint32_t{static_cast<unsigned char>(bytes[place + i])} << 8 * i;
  return out;
}

int blocks_of(std::size_t length) {
  return static_cast<int>((length + can_block_text_bytes - 1) / can_block_text_bytes);
}

struct Block {
  int number = 0, count = 0;
  std::size_t length = 0;
  std::uint32_t crc32 = 0;
  std::string which;
  std::string_view text;
};

std::optional<Block> parsed(std::string_view bytes) {
  if (bytes.size() <= can_block_header_bytes || number_at(bytes, 0, 1) != version) return {};
  Block out;
  out.number = static_cast<int>(number_at(bytes, 2, 2));
  out.count = static_cast<int>(number_at(bytes, 4, 2));
  out.length = number_at(bytes, 8, 4);
  out.crc32 = number_at(bytes, 12, 4);
  out.which = std::string(bytes.substr(1, 1)) + std::string(bytes.substr(4, 12));
  out.text = bytes.substr(can_block_header_bytes);
  if (out.length > can_document_bytes || out.count != blocks_of(out.length) ||
      out.number >= out.count)
    return {};
  const std::size_t begin = static_cast<std::size_t>(out.number) * can_block_text_bytes;
  if (out.text.size() != std::min(can_block_text_bytes, out.length - begin)) return {};
  return out;
}

}  // namespace

int CanDocument::blocks() const { return blocks_of(text.size()); }

std::string CanDocument::block(int number) const {
  std::string out;
  append(out, version, 1);
  append(out, static_cast<std::uint32_t>(sequence), 1);
  append(out, static_cast<std::uint32_t>(number), 2);
  append(out, static_cast<std::uint32_t>(blocks()), 2);
  append(out, 0, 2);
  append(out, static_cast<std::uint32_t>(text.size()), 4);
  append(out, crc32, 4);
  return out +
         text.substr(static_cast<std::size_t>(number) * can_block_text_bytes, can_block_text_bytes);
}

CanDocumentReader::Outcome CanDocumentReader::add(std::string_view bytes) {
  const auto block = parsed(bytes);
  if (!block || is_complete()) return Outcome::ignored;
  if (wanted_ > 0 && block->which != which_) {
    begin_again();
    return Outcome::other_document;
  }
  if (block->number != wanted_) return Outcome::ignored;
  which_ = block->which;
  blocks_ = block->count;
  text_ += block->text;
  ++wanted_;
  if (!is_complete() || crc32(text_) == block->crc32) return Outcome::taken;
  begin_again();
  return Outcome::damaged;
}

}  // namespace throwcal
