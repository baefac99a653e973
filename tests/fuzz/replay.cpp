// SPDX-License-Identifier: BSD-3-Clause
// In place of libFuzzer: each file of the folders given goes through the target once. Options are
// libFuzzer's, and left alone.
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <string_view>
#include <vector>

#include "tests/fuzz/outside_text.h"

int main(int argc, char** argv) {
  std::vector<std::filesystem::path> files;
  for (const std::string_view argument : std::vector<std::string_view>(argv + 1, argv + argc))
    if (!argument.starts_with('-'))
      for (const auto& entry : std::filesystem::directory_iterator(argument))
        files.push_back(entry.path());
  std::ranges::sort(files);
  for (const auto& file : files) {
    std::puts(file.c_str());
    std::fflush(stdout);  // the last one told is the one that failed
    std::ifstream in(file, std::ios::binary);
    const std::string bytes(std::istreambuf_iterator<char>(in), {});
    LLVMFuzzerTestOneInput(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size());
  }
  return files.empty();  // a test of nothing is none
}
