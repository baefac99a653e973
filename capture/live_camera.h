// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <chrono>
#include <cstdint>
#include <span>

#include "capture/camera.h"

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
inline ImageView view_of(std::span<std::uint8_t> slot, const Camera::Format& format) {
  const std::size_t bytes_a_pixel = format.format == PixelFormat::bgr    ? 3
                                    : format.format == PixelFormat::yuyv ? 2
                                                                         : 1;  // of the first plane
  return {slot.data(), format.width_px, format.height_px,
          static_cast<std::size_t>(format.width_px) * bytes_a_pixel, format.format};
}

}  // namespace throwcal
