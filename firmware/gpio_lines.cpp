// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/gpio_lines.h"

#include <fcntl.h>
#include <linux/gpio.h>
#include <sys/ioctl.h>

#include <array>
#include <cerrno>
#include <cstring>

namespace throwcal {
namespace {

std::uint64_t flags_of(const GpioLineSettings& settings) {
  std::uint64_t out = settings.active_low ? GPIO_V2_LINE_FLAG_ACTIVE_LOW : 0;
  if (settings.pull == Pull::up) out |= GPIO_V2_LINE_FLAG_BIAS_PULL_UP;
  if (settings.pull == Pull::down) out |= GPIO_V2_LINE_FLAG_BIAS_PULL_DOWN;
  if (settings.pull == Pull::none) out |= GPIO_V2_LINE_FLAG_BIAS_DISABLED;
  return out;
}

gpio_v2_line_request request_of(const GpioLineSettings& settings, std::uint64_t flags) {
  gpio_v2_line_request out{};
  out.offsets[0] = settings.line;
  out.num_lines = 1;
  std::strncpy(out.consumer, "throwcald", sizeof out.consumer - 1);
  out.config.flags = flags;
  return out;
}

void debounce_by_kernel(gpio_v2_line_request& request, std::chrono::milliseconds time) {
  request.config.num_attrs = 1;
  request.config.attrs[0].mask = 1;
  request.config.attrs[0].attr.id = GPIO_V2_LINE_ATTR_ID_DEBOUNCE;
  request.config.attrs[0].attr.debounce_period_us = static_cast<std::uint32_t>(1000 * time.count());
}

std::string sentence(const GpioLineSettings& settings, int error) {
  std::string out = to_string(settings) + ": ";
  if (error == EBUSY) return out + "another program or driver uses this line";
  if (error == EINVAL) return out + "the chip has no such line, or not as it is wired here";
  if (error == ENOTTY) return out + "this is no GPIO chip, or the kernel is older than 5.10";
  return out + std::strerror(error);
}

}  // namespace

GpioKernel::GpioKernel()
    : ioctl([](int fd, unsigned long request, void* argument) {
        return ::ioctl(fd, request, argument);
      }) {}

std::optional<GpioLine> GpioLine::request(const GpioLineSettings& settings, std::uint64_t flags,
                                          std::chrono::milliseconds debounce, std::string& why,
                                          const GpioKernel& kernel) {
  const FileHandle chip(
      ::open((kernel.folder / settings.chip).c_str(), O_RDWR | O_CLOEXEC | O_NONBLOCK));
  if (!chip.is_open()) {
    why = sentence(settings, errno);
    return {};
  }
  GpioLine out(kernel);
  auto request = request_of(settings, flags | flags_of(settings));
  out.is_debounced_ = debounce.count() > 0;
  if (out.is_debounced_) debounce_by_kernel(request, debounce);
  int result = kernel.ioctl(chip.get(), GPIO_V2_GET_LINE_IOCTL, &request);
  if (result < 0 && out.is_debounced_ && errno != EBUSY) {
    out.is_debounced_ = false;
    request = request_of(settings, flags | flags_of(settings));
    result = kernel.ioctl(chip.get(), GPIO_V2_GET_LINE_IOCTL, &request);
  }
  if (result < 0) {
    why = sentence(settings, errno);
    return {};
  }
  out.line_ = FileHandle(request.fd);
  fcntl(request.fd, F_SETFL, fcntl(request.fd, F_GETFL) | O_NONBLOCK);
  return out;
}

std::optional<GpioLine> GpioLine::input(const GpioLineSettings& settings,
                                        std::chrono::milliseconds debounce, std::string& why,
                                        const GpioKernel& kernel) {
  return request(
      settings,
      GPIO_V2_LINE_FLAG_INPUT | GPIO_V2_LINE_FLAG_EDGE_RISING | GPIO_V2_LINE_FLAG_EDGE_FALLING,
      debounce, why, kernel);
}

std::optional<GpioLine> GpioLine::output(const GpioLineSettings& settings, std::string& why,
                                         const GpioKernel& kernel) {
  return request(settings, GPIO_V2_LINE_FLAG_OUTPUT, {}, why, kernel);
}

std::optional<bool> GpioLine::is_active() const {
  gpio_v2_line_values values{.bits = 0, .mask = 1};
  if (kernel_.ioctl(fd(), GPIO_V2_LINE_GET_VALUES_IOCTL, &values) < 0) return {};
  return (values.bits & 1) != 0;
}

bool GpioLine::set(bool is_on) {
  gpio_v2_line_values values{.bits = is_on ? 1u : 0u, .mask = 1};
  return kernel_.ioctl(fd(), GPIO_V2_LINE_SET_VALUES_IOCTL, &values) >= 0;
}

std::optional<std::vector<GpioLine::Edge>> GpioLine::read_edges() {
  std::array<gpio_v2_line_event, 16> events{};
  std::vector<Edge> out;
  const ssize_t bytes = ::read(fd(), events.data(), sizeof events);
  if (bytes < 0 && (errno == EAGAIN || errno == EINTR)) return out;
  if (bytes <= 0) return {};
  bool were_lost = false;
  for (std::size_t i = 0; i < static_cast<std::size_t>(bytes) / sizeof events[0]; ++i) {
    const gpio_v2_line_event& event = events[i];
    were_lost = were_lost || event.line_seqno != edges_ + 1;
    edges_ = event.line_seqno;
    out.push_back(
        {event.id == GPIO_V2_LINE_EVENT_RISING_EDGE,
         std::chrono::steady_clock::time_point(std::chrono::nanoseconds(event.timestamp_ns))});
  }
  if (were_lost && !out.empty()) {
    const auto now = is_active();
    if (!now) return {};
    out.push_back({*now, out.back().at});
  }
  return out;
}

}  // namespace throwcal
