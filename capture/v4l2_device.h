// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <linux/videodev2.h>

#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>

#include "capture/camera_identity.h"

namespace throwcal {

/// What the kernel says to a command, with the device and the command: "/dev/video0: VIDIOC_S_FMT:
/// Device or resource busy".
class DeviceError : public std::runtime_error {
 public:
  DeviceError(const std::string& what, int code) : std::runtime_error(what), code_(code) {}
  int code() const { return code_; }  ///< errno
  /// The device went away: unplugged, or its driver unbound.
  bool is_gone() const;
  bool is_busy() const;  ///< another program has it

 private:
  int code_;
};

/// An open V4L2 device. Moves, never copies.
class V4l2Device {
 public:
  explicit V4l2Device(const std::string& path);  ///< non-blocking; throws DeviceError
  V4l2Device(V4l2Device&& other) noexcept;
  V4l2Device& operator=(V4l2Device&&) = delete;
  ~V4l2Device();

  const std::string& path() const { return path_; }
  int fd() const { return fd_; }

  /// ioctl(); `name` is the request's, for the message. Throws DeviceError.
  template <typename Argument>
  void command(unsigned long request, Argument& argument, const char* name) const {
    if (!attempt(request, &argument)) fail(name);
  }
  /// False where the driver refuses: it does not know the command, or not with this argument.
  template <typename Argument>
  bool try_command(unsigned long request, Argument& argument) const {
    return attempt(request, &argument);
  }
  [[noreturn]] void fail(const char* what) const;  ///< with errno

 private:
  bool attempt(unsigned long request, void* argument) const;

  std::string path_;
  int fd_;
};

/// Who is behind a device: the port, and the model and serial number of a USB camera, or the card's
/// name.
CameraIdentity identity_of(const V4l2Device& device, const v4l2_capability& has);

/// A driver's text: up to its end or `most` characters.
std::string text_of(const std::uint8_t* characters, std::size_t most);
/// "640x480".
std::string size_text(std::uint32_t width_px, std::uint32_t height_px);

}  // namespace throwcal
