// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <chrono>
#include <string>
#include <string_view>

namespace throwcal {

/// A POSIX ustar archive in memory (POSIX.1-1988): plain files only, names of up to 100 bytes.
class TarFile {
 public:
  explicit TarFile(std::chrono::system_clock::time_point modified) : modified_(modified) {}
  void add(std::string_view name, std::string_view content);
  std::string finish() &&;  ///< the archive's bytes

 private:
  std::chrono::system_clock::time_point modified_;
  std::string bytes_;
};

}  // namespace throwcal
