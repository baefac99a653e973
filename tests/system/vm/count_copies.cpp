// SPDX-License-Identifier: BSD-3-Clause
// Preloaded into a program (LD_PRELOAD), counts the bytes that it copies in pieces of a picture's
// row and more, and writes their sum to the file COPIES when the program ends.
#include <dlfcn.h>

#include <atomic>
#include <cstddef>
#include <cstdio>
#include <cstdlib>

namespace {

constexpr std::size_t a_row = 320;
std::atomic<unsigned long long> copied = 0;

using Copy = void* (*)(void*, const void*, std::size_t);

struct Report {
  ~Report() {
    const char* path = std::getenv("COPIES");
    if (std::FILE* file = path ? std::fopen(path, "w") : nullptr) {
      std::fprintf(file, "%llu\n", copied.load());
      std::fclose(file);
    }
  }
} report;

}  // namespace

extern "C" void* memcpy(void* to, const void* from, std::size_t bytes) noexcept {
  static const auto next = reinterpret_cast<Copy>(dlsym(RTLD_NEXT, "memcpy"));
  if (bytes >= a_row) copied += bytes;
  return next(to, from, bytes);
}

extern "C" void* memmove(void* to, const void* from, std::size_t bytes) noexcept {
  static const auto next = reinterpret_cast<Copy>(dlsym(RTLD_NEXT, "memmove"));
  if (bytes >= a_row) copied += bytes;
  return next(to, from, bytes);
}
