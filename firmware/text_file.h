// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <filesystem>
#include <string>
#include <string_view>

namespace throwcal {

/// A whole file. Throws InputError (path and cause) where it can't be read or is a directory.
std::string read_text_file(const std::filesystem::path& file);

/// At most `count` bytes from `offset` on, fewer at the end. Throws InputError as above, and where
/// `offset` lies outside.
struct FilePart {
  std::int64_t file_bytes = 0;
  std::string bytes;
};
FilePart read_file_part(const std::filesystem::path& file, std::int64_t offset, std::size_t count);

/// All or nothing, also through a power cut: a file beside it is written and synced, then takes the
/// name. Throws InputError (path and cause).
/// A new file gets `mode` (less the process' umask).
void write_text_file(const std::filesystem::path& file, std::string_view text,
                     unsigned mode = 0644);

/// The shortest decimal that reads back as the same double; never in a locale.
std::string shortest(double value);

}  // namespace throwcal
