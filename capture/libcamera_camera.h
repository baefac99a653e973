// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <memory>
#include <mutex>
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
/// times a second until it is back, and it must be the same one; `lost` says so meanwhile.
class LibcameraCamera : public Camera {
 public:
  /// Opens the camera, to know what it gives. Throws std::runtime_error: the camera, what was asked
  /// and what there is; of a camera that is not there only unless it may be missing.
  LibcameraCamera(const CameraSource& source, const std::string& which);

  const std::string& name() const override { return source_.name; }
  Format format() const override { return format_; }
  CameraModel model() const override { return source_.model; }
  void start() override {}  ///< with the first next(): its failure is one of many to survive
  Outcome next(std::span<std::uint8_t> slot, Frame& frame) override;
  void interrupt() override { interrupted_.set(); }
  std::string error() const override { return error_; }
  CameraIdentity identity() const override;
  PictureSettings settings() const override;

 private:
  void open();
  void tell(const CameraIdentity& found);
  void read_settings(const libcamera::ControlList& told);
  Outcome lost(std::string why);
  Outcome give(const LibcameraStream::Picture& picture, std::span<std::uint8_t> slot, Frame& frame);

  CameraSource source_;
  std::string id_, error_;
  Format format_;
  PixelFormat pixels_ = PixelFormat::grey;  ///< of the frames
  std::optional<CameraIdentity> accepted_;  ///< when it was first opened
  mutable std::mutex mutex_;                ///< guards the next two
  CameraIdentity identity_;                 ///< of what is there now, right or wrong
  PictureSettings settings_;
  EventFlag interrupted_;
  std::unique_ptr<LibcameraStream> stream_;
  bool is_streaming_ = false;
  std::optional<std::string> broken_;   ///< why the frame just given is the stream's last
  std::vector<std::string> automatic_;  ///< what it changes by itself
  std::optional<RawPicture> picture_;
  SequenceCounter sequence_;
  BootClock boot_clock_;
  FrameClock clock_;
};

}  // namespace throwcal
