// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <cstdint>
#include <deque>
#include <filesystem>
#include <optional>
#include <span>

#include "firmware/file_handle.h"
#include "firmware/sha256.h"

namespace throwcal {

/// A file that is sent to somebody, in parts: as it was when it was opened, or no further. It may
/// be removed meanwhile.
class OutgoingFile {
 public:
  /// What tells one content of one file from another.
  struct Stamp {
    std::uint64_t device = 0, inode = 0, bytes = 0;
    std::int64_t written_ns = 0;
    bool operator==(const Stamp&) const = default;
  };

  /// Throws InputError (path and cause) where it can't be opened, or is no file.
  explicit OutgoingFile(const std::filesystem::path& file);

  std::uint64_t bytes() const { return stamp_.bytes; }
  const Stamp& stamp() const { return stamp_; }
  /// From `offset` on; nothing where it was written to since it was opened, or can't be read.
  std::optional<std::size_t> read(std::uint64_t offset, std::span<char> out) const;

 private:
  FileHandle file_;
  Stamp stamp_;
};

/// The SHA-256 of files that may be large, found a piece at a time, so that nobody waits, and once
/// for all who ask. The last ones are remembered.
class FileDigests {
 public:
  static constexpr std::size_t piece_bytes = 256 * 1024, remembered = 32;

  /// Looks at a piece more; nothing: there is more to look at. Throws InputError where the file is
  /// written to meanwhile, or can't be read.
  std::optional<Sha256Digest> look_further(const OutgoingFile& file);

 private:
  struct Search {
    OutgoingFile::Stamp stamp;
    Sha256 hash{};
    std::uint64_t looked_at_bytes = 0;
    std::optional<Sha256Digest> digest{};
  };
  std::deque<Search> searches_;  ///< the oldest first
};

}  // namespace throwcal
