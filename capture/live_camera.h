// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <chrono>
#include <cstdint>
#include <mutex>
#include <optional>
#include <span>
#include <string>

#include "capture/camera.h"
#include "capture/camera_factory.h"
#include "capture/event_flag.h"
#include "capture/frame_clock.h"
#include "capture/raw_picture.h"
#include "capture/sequence_counter.h"
#include "capture/v4l2_device.h"
#include "capture/v4l2_stream.h"

namespace throwcal {

/// On CLOCK_MONOTONIC.
inline HostTime now() {
  return HostTime(std::chrono::duration_cast<HostClock::duration>(
      std::chrono::steady_clock::now().time_since_epoch()));
}

/// A camera that can be lost: what V4L2's and libcamera's have in common. Where it is unplugged, or
/// does not start, it is tried again four times a second until it is back, and it must be the same
/// one; `lost` says so meanwhile.
class LiveCamera : public Camera {
 public:
  const std::string& name() const override { return source_.name; }
  Format format() const override { return format_; }
  CameraModel model() const override { return source_.model; }
  /// Its device starts with the first next(): its failure is one of many to survive. The thread
  /// goes before all others (SCHED_RR) where the system allows it, for a driver's few buffers do
  /// not wait; else somebody else may see to that, by its name, NAME.live.
  void start() override;
  Outcome next(std::span<std::uint8_t> slot, Frame& frame) override;
  void interrupt() override { interrupted_.set(); }
  std::string error() const override { return error_; }
  CameraIdentity identity() const override;
  PictureSettings settings() const override;

 protected:
  /// `place` names it in messages.
  LiveCamera(const CameraSource& source, std::string place);
  /// To be called by whoever is made: throws std::runtime_error, of a camera that is not there only
  /// unless it may be missing.
  void open_first();

  /// Makes and configures the stream; calls meet() before it changes anything in the camera, and
  /// accept() when it knows what the pictures are. Throws.
  virtual void open() = 0;
  virtual bool is_open() const = 0;
  virtual void close() = 0;
  /// Waits for a frame of the open stream. May throw DeviceError: then the camera is lost.
  virtual Outcome next_of_stream(std::span<std::uint8_t> slot, Frame& frame) = 0;
  virtual std::string stream_error(const DeviceError& error) const;

  /// Who is there now: told, and checked. Throws WrongCamera.
  void meet(const CameraIdentity& found);
  /// What it gives; the same as before, or it throws.
  void accept(CameraIdentity found, const V4l2Format& given);
  Outcome lost(std::string why);
  /// All of a frame but its number and time.
  void fill(Frame& frame, const FrameClock::Moment& moment, std::span<std::uint8_t> slot,
            double exposure_s) const;

  /// Without a frame: then a camera is lost.
  static constexpr std::chrono::milliseconds patience{2000};
  static constexpr int max_idle_wakes = 10;

  CameraSource source_;
  std::string place_, error_;
  EventFlag interrupted_;
  std::optional<RawPicture> picture_;
  SequenceCounter sequence_;
  FrameClock clock_;
  std::optional<std::string> broken_;  ///< why the frame just given is the stream's last
  mutable std::mutex mutex_;           ///< guards the next two
  CameraIdentity identity_;            ///< of what is there now, right or wrong
  PictureSettings settings_;

 private:
  bool may_pass(const std::runtime_error& error) const;
  std::string open_error(const std::runtime_error& error) const;

  Format format_, given_;                   ///< as promised, and of the frames
  std::optional<CameraIdentity> accepted_;  ///< when it was last opened
};

/// At the port is another camera than belongs there.
struct WrongCamera : std::runtime_error {
  using std::runtime_error::runtime_error;
};

}  // namespace throwcal
