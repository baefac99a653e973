// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "capture/camera.h"
#include "capture/camera_factory.h"
#include "capture/event_flag.h"
#include "capture/frame_clock.h"
#include "capture/raw_picture.h"
#include "capture/sequence_counter.h"
#include "capture/v4l2_stream.h"

namespace throwcal {

/// A camera behind the kernel's V4L2, by the path of its device. Where it is unplugged, or does not
/// start, it is tried again four times a second until it is back, and it must be the same one;
/// `lost` says so meanwhile.
class V4l2Camera : public Camera {
 public:
  /// Opens the device, to know what it gives. Throws std::runtime_error: the camera, the device,
  /// what was asked and what there is; of a device that is not there only unless it may be missing.
  V4l2Camera(const CameraSource& source, std::string path);

  const std::string& name() const override { return source_.name; }
  Format format() const override { return format_; }
  CameraModel model() const override { return source_.model; }
  void start() override {}  ///< with the first next(): its failure is one of many to survive
  Outcome next(std::span<std::uint8_t> slot, Frame& frame) override;
  void interrupt() override { interrupted_.set(); }
  std::string error() const override { return error_; }
  CameraIdentity identity() const override;
  PictureSettings settings() const override;
  std::optional<UsbStream> usb_stream() const override;

 private:
  void open();
  void tell(const CameraIdentity& found);
  void give_back(const V4l2Stream::Buffer& buffer);
  void adopt_settings();
  void heed_event();
  std::string stream_error(const DeviceError& error) const;
  Outcome lost(std::string why);
  Outcome take(const V4l2Stream::Buffer& buffer, std::span<std::uint8_t> slot, Frame& frame);
  Outcome give(const V4l2Stream::Buffer& buffer, bool is_second, std::span<std::uint8_t> slot,
               Frame& frame);

  CameraSource source_;
  std::string path_, error_;
  Format format_;
  PixelFormat pixels_ = PixelFormat::grey;  ///< of the frames
  double field_interval_s_ = 0.0;
  std::optional<CameraIdentity> accepted_;  ///< when it was last opened
  PictureNumbers remembered_;               ///< that it had then
  mutable std::mutex mutex_;                ///< guards the next two
  CameraIdentity identity_;                 ///< of what is there now, right or wrong
  PictureSettings settings_;
  EventFlag interrupted_;
  std::unique_ptr<V4l2Stream> stream_;
  bool is_streaming_ = false;
  int frames_ = 0;                     ///< of this stream
  std::optional<std::string> broken_;  ///< why the frame just given is the stream's last
  std::optional<RawPicture> picture_;
  std::optional<V4l2Stream::Buffer> half_;  ///< of which the second field is still to be given
  SequenceCounter sequence_;
  std::uint32_t drivers_sequence_ = 0;
  std::uint64_t number_ = 0;  ///< of the frame last dequeued
  FrameClock clock_;
  FrameClock::Moment moment_;
};

}  // namespace throwcal
