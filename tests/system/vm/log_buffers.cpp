// SPDX-License-Identifier: BSD-3-Clause
// Preloaded into a program (LD_PRELOAD), writes what the driver answers to each VIDIOC_DQBUF to the
// file BUFFER_LOG: "FD SEQUENCE FLAGS STAMP_NS FIELD NOW_NS", so that what the program counts can
// be compared with what the kernel said.
#include <dlfcn.h>
#include <linux/videodev2.h>

#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <ctime>

extern "C" int ioctl(int fd, unsigned long request, ...) noexcept {
  static const auto next =
      reinterpret_cast<int (*)(int, unsigned long, void*)>(dlsym(RTLD_NEXT, "ioctl"));
  static std::FILE* const log = std::fopen(std::getenv("BUFFER_LOG"), "w");
  va_list arguments;
  va_start(arguments, request);
  void* const argument = va_arg(arguments, void*);
  va_end(arguments);
  const int result = next(fd, request, argument);
  if (result == 0 && request == VIDIOC_DQBUF) {
    timespec now{};
    clock_gettime(CLOCK_MONOTONIC, &now);
    const auto& buffer = *static_cast<const v4l2_buffer*>(argument);
    std::fprintf(log, "%d %u %#x %lld %u %lld\n", fd, buffer.sequence, buffer.flags,
                 buffer.timestamp.tv_sec * 1000000000LL + buffer.timestamp.tv_usec * 1000LL,
                 buffer.field, now.tv_sec * 1000000000LL + now.tv_nsec);
    std::fflush(log);
  }
  return result;
}
