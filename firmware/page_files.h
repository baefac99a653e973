// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <span>
#include <string_view>

namespace throwcal {

/// A file of firmware/page, put into the program when it is built.
struct PageFile {
  std::string_view name;  ///< "index.html"
  std::string_view bytes;
};

std::span<const PageFile> page_files();  ///< page_files.cpp is made by CMakeLists.txt

}  // namespace throwcal
