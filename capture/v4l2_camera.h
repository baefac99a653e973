// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <memory>
#include <optional>
#include <string>

#include "capture/live_camera.h"
#include "capture/v4l2_stream.h"

namespace throwcal {

/// A camera behind the kernel's V4L2, by the path of its device.
class V4l2Camera : public LiveCamera {
 public:
  /// Opens the device, to know what it gives. Throws std::runtime_error: the camera, the device,
  /// what was asked and what there is; of a device that is not there only unless it may be missing.
  V4l2Camera(const CameraSource& source, std::string path);

  std::optional<UsbStream> usb_stream() const override;

 private:
  void open() override;
  bool is_open() const override { return stream_ != nullptr; }
  void close() override;
  Outcome next_of_stream(std::span<std::uint8_t> slot, Frame& frame) override;
  std::string stream_error(const DeviceError& error) const override;
  void adopt_settings();
  void heed_event();
  Outcome take(const V4l2Stream::Buffer& buffer, std::span<std::uint8_t> slot, Frame& frame);
  Outcome give(const V4l2Stream::Buffer& buffer, bool is_second, std::span<std::uint8_t> slot,
               Frame& frame);
  void give_back(const V4l2Stream::Buffer& buffer);

  std::unique_ptr<V4l2Stream> stream_;
  bool is_streaming_ = false;
  int frames_ = 0;             ///< of this stream
  PictureNumbers remembered_;  ///< of the one before
  double field_interval_s_ = 0.0;
  std::optional<V4l2Stream::Buffer> half_;  ///< of which the second field is still to be given
  std::uint32_t drivers_sequence_ = 0;
  std::uint64_t number_ = 0;  ///< of the frame last dequeued
  FrameClock::Moment moment_;
};

}  // namespace throwcal
