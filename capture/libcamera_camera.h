// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <memory>
#include <optional>
#include <string>

#include "capture/boot_clock.h"
#include "capture/camera.h"
#include "capture/camera_factory.h"
#include "capture/event_flag.h"
#include "capture/frame_clock.h"
#include "capture/libcamera_stream.h"
#include "capture/raw_picture.h"
#include "capture/sequence_counter.h"

namespace throwcal {

/// A camera behind libcamera. Where it is unplugged, or does not start, it is tried again four
/// times a second until it is back; `lost` says so meanwhile.
class LibcameraCamera : public Camera {
 public:
  /// Opens the camera once, to know what it gives. Throws std::runtime_error: the camera, what was
  /// asked and what there is.
  LibcameraCamera(const CameraSource& source, const std::string& which);

  const std::string& name() const override { return source_.name; }
  Format format() const override { return format_; }
  CameraModel model() const override { return source_.model; }
  void start() override {}  ///< with the first next(): its failure is one of many to survive
  Outcome next(std::span<std::uint8_t> slot, Frame& frame) override;
  void interrupt() override { interrupted_.set(); }
  std::string error() const override { return error_; }

 private:
  V4l2Request request() const;
  LibcameraControls controls() const;
  bool open();
  Outcome lost(std::string why);
  Outcome give(const LibcameraStream::Picture& picture, std::span<std::uint8_t> slot, Frame& frame);

  CameraSource source_;
  std::string id_, error_;
  Format format_;
  EventFlag interrupted_;
  std::unique_ptr<LibcameraStream> stream_;
  bool is_streaming_ = false;
  std::optional<RawPicture> picture_;
  SequenceCounter sequence_;
  BootClock boot_clock_;
  FrameClock clock_;
};

}  // namespace throwcal
