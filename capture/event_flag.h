// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstdint>
#include <system_error>

namespace throwcal {

/// A flag that another thread sets and that poll() can wait for, beside a device.
class EventFlag {
 public:
  EventFlag() : fd_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
    if (fd_ < 0) throw std::system_error(errno, std::generic_category(), "eventfd");
  }
  EventFlag(const EventFlag&) = delete;
  EventFlag& operator=(const EventFlag&) = delete;
  ~EventFlag() { close(fd_); }

  void set() {
    const std::uint64_t one = 1;
    [[maybe_unused]] const auto written = write(fd_, &one, sizeof one);  // full is set, too
  }

  void clear() {
    std::uint64_t times;
    [[maybe_unused]] const auto had = read(fd_, &times, sizeof times);  // clear is cleared, too
  }
  int fd() const { return fd_; }  ///< readable while it is set

  enum class Woken { by_flag, by_device, by_event, by_time };
  /// Waits for the flag, for `device` to be readable or broken (-1: none) or to tell an event, or
  /// for the time.
  Woken wait(int device, std::chrono::milliseconds most) const {
    pollfd waits[]{{fd_, POLLIN, 0}, {device, POLLIN | POLLPRI, 0}};
    int ready;
    do ready = poll(waits, 2, static_cast<int>(most.count()));
    while (ready < 0 && errno == EINTR);
    if (waits[0].revents) return Woken::by_flag;
    if (waits[1].revents & POLLPRI && !(waits[1].revents & POLLERR)) return Woken::by_event;
    return ready > 0 ? Woken::by_device : Woken::by_time;
  }

 private:
  int fd_;
};

}  // namespace throwcal
