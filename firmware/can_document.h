// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <cstdint>
#include <string>
#include <string_view>

namespace throwcal {

/// An ISO-TP transfer is one block of at most this many bytes: a header that says which block of
/// which document it is, then a piece of that document.
constexpr std::size_t can_block_bytes = 4000, can_block_header_bytes = 16;
constexpr std::size_t can_block_text_bytes = can_block_bytes - can_block_header_bytes;
/// What CanResult::length holds.
constexpr std::size_t can_document_bytes = (1 << 24) - 1;

/// A calibration document, to be sent in blocks.
struct CanDocument {
  int sequence = 0;  ///< 0: there is none
  std::string text;
  std::uint32_t crc32 = 0;

  int blocks() const;
  /// `number` from 0 to blocks() - 1.
  std::string block(int number) const;
};

/// Puts a document together from its blocks, whatever bytes come.
class CanDocumentReader {
 public:
  enum class Outcome {
    taken,
    ignored,         ///< no block, or not the one wanted: as from a transfer asked for before
    other_document,  ///< the box has a newer one: the whole begins again
    damaged,         ///< all blocks came, but their CRC-32 is another: the whole begins again
  };
  Outcome add(std::string_view block);

  int wanted() const { return wanted_; }  ///< the block that is to come next
  bool is_complete() const { return blocks_ > 0 && wanted_ == blocks_; }
  const std::string& text() const { return text_; }

 private:
  void begin_again() { *this = {}; }

  std::string which_;  ///< the header's part that all blocks of a document share
  std::string text_;
  int wanted_ = 0, blocks_ = 0;
};

}  // namespace throwcal
