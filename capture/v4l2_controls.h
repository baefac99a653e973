// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "capture/device_wishes.h"
#include "capture/v4l2_device.h"

namespace throwcal {

/// What a camera lets one set of its pictures.
struct V4l2Control {
  std::string key;  ///< of the rig file: "exposure_s"
  double least = 0.0, most = 0.0, now = 0.0;
  bool is_automatic = false;  ///< now
};
std::vector<V4l2Control> list_controls(const V4l2Device& device);

/// A camera's exposure, gain, focus and white balance, held: its automatics off, each number set,
/// read back, and set again when another program has changed it. Borrows the device for its life.
class V4l2Controls {
 public:
  /// Sets what is wished for: throws DeviceError, or std::runtime_error (the number, what was
  /// wanted and what there is). Of `remembered`, which a camera plugged in anew had before, what
  /// can be set. Of the rest, what no automatic changes is held as it is.
  V4l2Controls(const V4l2Device& device, const PictureWishes& wishes,
               const PictureNumbers& remembered);

  /// To be called when the stream has run for a while: what automatics have found is held.
  void hold_the_rest();
  /// Sets all that is held, whatever it reads as: a stream may begin with other numbers.
  void set_again();
  /// After the driver has told an event: sets back what is not as it was. True if there was any.
  /// Throws DeviceError where the camera is gone.
  bool restore();
  const PictureSettings& settings() const { return settings_; }

 private:
  struct Held {
    std::uint32_t id = 0;
    std::int32_t value = 0;
  };
  void hold(std::uint32_t id, std::int32_t value);
  void read_settings();

  const V4l2Device& device_;
  bool is_automatic_wanted_;
  std::vector<Held> held_;
  PictureSettings settings_;
};

}  // namespace throwcal
