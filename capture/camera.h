// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "capture/camera_identity.h"
#include "capture/device_wishes.h"
#include "capture/frame.h"
#include "capture/usb_load.h"
#include "estimator/camera_model.h"

namespace throwcal {

/// A source of frames: a driver. Made by make_camera(); used by one thread at a time.
class Camera {
 public:
  virtual ~Camera() = default;

  struct Format {
    int width_px = 0, height_px = 0;
    PixelFormat format = PixelFormat::grey;
    double frames_per_s = 0.0;
    bool is_interlaced = false;  ///< then two of them are a frame of the driver's
  };
  enum class Outcome { frame, damaged, lost, end, failed, interrupted };

  virtual const std::string& name() const = 0;
  virtual Format format() const = 0;      ///< fixed from construction on; sizes the ring's slots
  virtual CameraModel model() const = 0;  ///< the lens in front of it
  /// True: the source waits for its reader and loses nothing (a file). False: light does not wait.
  virtual bool waits_for_reader() const { return false; }
  virtual void start() = 0;
  /// Waits for the next frame and writes its pixels into `slot` (format()'s size, tightly packed),
  /// its facts into `frame`; `frame.image` views the slot. `damaged`: one came that cannot be used
  /// (its sequence is told). `lost`: there is none, but there may be again; error() says why.
  /// `end`: the source has no more. `failed`: nor will it have, error() says what and where.
  virtual Outcome next(std::span<std::uint8_t> slot, Frame& frame) = 0;
  virtual void
  interrupt() = 0;  ///< thread-safe: makes a waiting next() return `interrupted`, at once
  virtual std::string error() const { return {}; }

  // Of a real device, the first two thread-safe:
  virtual CameraIdentity identity() const { return {}; }
  virtual PictureSettings settings() const { return {}; }
  /// Nothing where it is on no USB bus, or is missing.
  virtual std::optional<UsbStream> usb_stream() const { return {}; }
};

}  // namespace throwcal
