// SPDX-License-Identifier: BSD-3-Clause
#include "capture/v4l2_device.h"

#include <fcntl.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <system_error>
#include <utility>

namespace throwcal {
namespace {

std::string reason(int code) { return std::generic_category().message(code); }

}  // namespace

std::string text_of(const std::uint8_t* characters, std::size_t most) {
  const auto* text = reinterpret_cast<const char*>(characters);
  return {text, strnlen(text, most)};
}

std::string size_text(std::uint32_t width, std::uint32_t height) {
  return std::to_string(width) + "x" + std::to_string(height);
}

bool DeviceError::is_gone() const { return code_ == ENODEV || code_ == ENXIO || code_ == ENOENT; }
bool DeviceError::is_busy() const { return code_ == EBUSY; }

CameraIdentity identity_of(const V4l2Device& device, const v4l2_capability& has) {
  CameraIdentity out = usb_identity(device.path());
  out.port = text_of(has.bus_info, sizeof has.bus_info);
  if (out.port.empty()) out.port = device.path();
  if (out.model.empty()) out.model = text_of(has.card, sizeof has.card);
  return out;
}

V4l2Device::V4l2Device(const std::string& path)
    : path_(path), fd_(open(path.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC)) {
  if (fd_ < 0) throw DeviceError(path + ": " + reason(errno), errno);
}

V4l2Device::V4l2Device(V4l2Device&& other) noexcept
    : path_(std::move(other.path_)), fd_(std::exchange(other.fd_, -1)) {}

V4l2Device::~V4l2Device() {
  if (fd_ >= 0) close(fd_);
}

bool V4l2Device::attempt(unsigned long request, void* argument) const {
  int result;
  do result = ioctl(fd_, request, argument);
  while (result < 0 && errno == EINTR);
  return result == 0;
}

void V4l2Device::fail(const char* what) const {
  const int code = errno;
  throw DeviceError(path_ + ": " + what + ": " + reason(code), code);
}

}  // namespace throwcal
