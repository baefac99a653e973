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
  /// Throws DeviceError, or std::runtime_error: the number, what was wanted and what there is.
  V4l2Controls(const V4l2Device& device, const PictureWishes& wishes);

  /// After the driver has announced an event, or has started to stream: sets back what is not as it
  /// was. True if there was any. Throws DeviceError.
  bool restore();
  const PictureSettings& settings() const { return settings_; }
  /// What a camera plugged in anew is to be set to: all that is held.
  const PictureWishes& held() const { return wishes_; }

 private:
  struct Held {
    std::uint32_t id = 0;
    std::int32_t value = 0;
  };
  void hold();
  void subscribe() const;

  const V4l2Device& device_;
  std::vector<Held> held_;
  PictureWishes wishes_;
  PictureSettings settings_;
};

}  // namespace throwcal
