// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <chrono>
#include <memory>
#include <optional>
#include <vector>

#include "capture/rig.h"
#include "firmware/preview.h"

namespace throwcal {

/// The newest picture of each camera, for whoever looks: made when it is asked for, and at most
/// five times a second a camera, however many look.
class Previews {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::milliseconds period{200};
  /// So long a picture may stay that is followed only by frames that no detector has seen yet.
  static constexpr std::chrono::milliseconds patience{1000};

  explicit Previews(Rig& rig) : rig_(rig), shown_(rig.stats().size()) {}

  /// Null where the camera has not delivered a frame yet.
  std::shared_ptr<const Preview> newest(CameraId camera, Clock::time_point now);

 private:
  struct Shown {
    std::shared_ptr<const Preview> preview;
    std::optional<Clock::time_point> made;
    HostTime of{};
  };

  Rig& rig_;
  std::vector<Shown> shown_;
};

}  // namespace throwcal
