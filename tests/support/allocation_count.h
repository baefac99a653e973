// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <cstdlib>

// For one file of a test program: it replaces malloc. A test that counts says it skips where
// COUNTS_ALLOCATIONS is not defined.
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__) && defined(__GLIBC__)
#define COUNTS_ALLOCATIONS
// Every allocation of the program, Eigen's and OpenCV's included, comes by here.
extern "C" void* __libc_malloc(std::size_t);
static thread_local long allocations = 0;  ///< by this thread
extern "C" void* malloc(std::size_t size) {
  ++allocations;
  return __libc_malloc(size);
}
#endif
