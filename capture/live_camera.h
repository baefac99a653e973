// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <chrono>
#include <cstdint>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>

#include "capture/camera.h"
#include "capture/camera_factory.h"
#include "capture/v4l2_device.h"
#include "capture/v4l2_stream.h"

// What the drivers of cameras that can be lost have in common.
namespace throwcal {

/// Between two attempts to open a camera that is lost.
constexpr std::chrono::milliseconds retry_period{250};
/// Without a frame: then a camera is lost.
constexpr std::chrono::milliseconds patience{2000};

/// On CLOCK_MONOTONIC.
inline HostTime now() {
  return HostTime(std::chrono::duration_cast<HostClock::duration>(
      std::chrono::steady_clock::now().time_since_epoch()));
}

/// A slot with a picture in it, tightly packed.
inline ImageView view_of(std::span<std::uint8_t> slot, int width_px, int height_px,
                         PixelFormat format) {
  const std::size_t bytes_a_pixel = format == PixelFormat::bgr    ? 3
                                    : format == PixelFormat::yuyv ? 2
                                                                  : 1;  // of the first plane
  return {slot.data(), width_px, height_px, static_cast<std::size_t>(width_px) * bytes_a_pixel,
          format};
}

/// What pictures come in: "640x480 YUYV at 30/s".
std::string mode_text(const V4l2Format& format);

/// At the port is another camera than belongs there.
struct WrongCamera : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Whether that is the camera that the rig file wants and that was here before (`accepted`). Throws
/// WrongCamera: where, who is there and who is expected.
void check_identity(const std::string& place, const CameraIdentity& found,
                    const CameraSource& source, const std::optional<CameraIdentity>& accepted);

/// Whether somebody may put it right while the box runs: plug it in, or the right one.
bool may_pass(const std::runtime_error& error);

/// Why a camera can't be opened now, as a person is told it.
std::string open_error(const std::string& place, const std::runtime_error& error, bool was_here);

/// Of a camera that is missing: what holds whatever it will give.
Camera::Format widest_format(const CameraSource& source);

}  // namespace throwcal
