// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "estimator/observation.h"
#include "estimator/time.h"

namespace throwcal {

enum class PixelFormat { grey, yuyv, nv12, bgr };

/// What moment the driver's stamp names; the clock map turns each into the middle of row 0's
/// exposure.
enum class TimestampSource { start_of_exposure, end_of_frame, dequeue, unknown };

/// As a person is told it: "start of exposure".
constexpr std::string_view description(TimestampSource source) {
  switch (source) {
    case TimestampSource::start_of_exposure:
      return "start of exposure";
    case TimestampSource::end_of_frame:
      return "end of frame";
    case TimestampSource::dequeue:
      return "when it was dequeued";
    case TimestampSource::unknown:
      break;
  }
  return "unknown";
}

/// Pixels owned by someone else.
struct ImageView {
  const std::uint8_t* data = nullptr;
  int width_px = 0, height_px = 0;
  std::size_t stride_bytes = 0;
  PixelFormat format = PixelFormat::grey;
};

/// One picture of one camera. Pixels are valid while its FrameLease lives.
struct Frame {
  CameraId camera = 0;
  std::uint64_t sequence = 0;    ///< a gap = frames lost before they reached us
  HostTime row0_mid_exposure{};  ///< middle of the exposure of row 0, on the box's clock
  TimestampSource timestamp_source = TimestampSource::unknown;
  std::chrono::nanoseconds row_time{}, exposure{}, time_sigma{};  ///< row_time 0 = global shutter
  ImageView image;
};

}  // namespace throwcal
