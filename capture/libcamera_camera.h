// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <memory>
#include <string>

#include "capture/boot_clock.h"
#include "capture/libcamera_stream.h"
#include "capture/live_camera.h"

namespace throwcal {

/// A camera behind libcamera.
class LibcameraCamera : public LiveCamera {
 public:
  /// Opens the camera, to know what it gives. Throws std::runtime_error: the camera, what was asked
  /// and what there is; of a camera that is not there only unless it may be missing.
  LibcameraCamera(const CameraSource& source, const std::string& which);

 private:
  void open() override;
  bool is_open() const override { return stream_ != nullptr; }
  void close() override;
  Outcome next_of_stream(std::span<std::uint8_t> slot, Frame& frame) override;
  Outcome give(const LibcameraStream::Picture& picture, std::span<std::uint8_t> slot, Frame& frame);
  void read_settings(const libcamera::ControlList& told);

  std::string which_;  ///< its id, once it is known
  std::unique_ptr<LibcameraStream> stream_;
  bool is_streaming_ = false;
  BootClock boot_clock_;
};

}  // namespace throwcal
