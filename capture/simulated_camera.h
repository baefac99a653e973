// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <condition_variable>
#include <mutex>
#include <string>

#include "capture/camera_factory.h"
#include "capture/simulated_picture.h"

namespace throwcal {

/// A camera of a simulated site: renders its frames. Paced, it exposes by its own free-running
/// clock and keeps a few finished frames for a late reader, as a kernel driver does; the rest are
/// lost and show as a gap in `sequence`.
class SimulatedCamera : public Camera {
 public:
  explicit SimulatedCamera(const CameraSource& source);

  const std::string& name() const override { return source_.name; }
  Format format() const override;
  CameraModel model() const override { return source_.model; }
  bool waits_for_reader() const override { return !source_.paced; }
  void start() override;
  Outcome next(std::span<std::uint8_t> slot, Frame& frame) override;
  void interrupt() override;

 private:
  double true_time_s(std::uint64_t number) const;  ///< middle of row 0's exposure
  std::chrono::steady_clock::time_point due(std::uint64_t number) const;
  bool wait_until_due();

  CameraSource source_;
  SimulatedPicture picture_;
  std::uint64_t number_ = 0;  ///< of the next frame, counted from the scene's start
  std::mutex mutex_;
  std::condition_variable wake_;
  bool interrupted_ = false;
};

}  // namespace throwcal
