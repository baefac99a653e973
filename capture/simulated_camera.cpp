// SPDX-License-Identifier: BSD-3-Clause
#include "capture/simulated_camera.h"

#include <algorithm>
#include <cmath>

namespace throwcal {
namespace {

constexpr std::uint64_t buffered_frames = 8;  ///< finished frames that wait for a late reader

}  // namespace

SimulatedCamera::SimulatedCamera(const CameraSource& source)
    : source_(source), picture_(source.scene, source.id) {}

Camera::Format SimulatedCamera::format() const {
  const auto& settings = source_.scene->settings();
  return {settings.width_px, settings.height_px, PixelFormat::grey, settings.frames_per_s};
}

double SimulatedCamera::true_time_s(std::uint64_t number) const {
  return source_.scene->frame_phase_s(source_.id) +
         static_cast<double>(number) / source_.scene->settings().frames_per_s;
}

/// A frame is there when its last row has been exposed. steady_clock is CLOCK_MONOTONIC, the clock
/// of HostTime.
std::chrono::steady_clock::time_point SimulatedCamera::due(std::uint64_t number) const {
  const auto& settings = source_.scene->settings();
  const double ready_s =
      true_time_s(number) + 0.5 * settings.exposure_s + settings.row_time_s * settings.height_px;
  return std::chrono::steady_clock::time_point(source_.scene_start.time_since_epoch() +
                                               from_seconds(ready_s));
}

void SimulatedCamera::start() {
  number_ = 0;
  if (!source_.paced) return;
  const double since_s = seconds(std::chrono::steady_clock::now() - due(0));
  number_ = static_cast<std::uint64_t>(
      std::max(0.0, std::ceil(since_s * source_.scene->settings().frames_per_s)));
}

bool SimulatedCamera::wait_until_due() {
  std::unique_lock lock(mutex_);
  const auto is_interrupted = [this] { return interrupted_; };
  if (!source_.paced) return !interrupted_;
  if (wake_.wait_until(lock, due(number_), is_interrupted)) return false;
  const auto now = std::chrono::steady_clock::now();
  const double late_frames = seconds(now - due(number_)) * source_.scene->settings().frames_per_s;
  if (late_frames > static_cast<double>(buffered_frames))
    number_ += static_cast<std::uint64_t>(late_frames) - buffered_frames + 1;
  return true;
}

Camera::Outcome SimulatedCamera::next(std::span<std::uint8_t> slot, Frame& frame) {
  if (source_.scene_end_s > 0 && true_time_s(number_) >= source_.scene_end_s) return Outcome::end;
  if (!wait_until_due()) return Outcome::interrupted;
  const SimulatedSceneSettings& settings = source_.scene->settings();
  const double true_s = true_time_s(number_);
  picture_.expose(true_s, number_, slot.data());
  frame.camera = source_.id;
  frame.sequence = number_++;
  frame.row0_mid_exposure =
      source_.scene_start + from_seconds(true_s - source_.scene->time_offset_s(source_.id));
  frame.timestamp_source = TimestampSource::start_of_exposure;
  frame.row_time = from_seconds(settings.row_time_s);
  frame.exposure = from_seconds(settings.exposure_s);
  frame.time_sigma = {};
  frame.image = {slot.data(), settings.width_px, settings.height_px,
                 static_cast<std::size_t>(settings.width_px), PixelFormat::grey};
  return Outcome::frame;
}

void SimulatedCamera::interrupt() {
  {
    const std::lock_guard lock(mutex_);
    interrupted_ = true;
  }
  wake_.notify_all();
}

}  // namespace throwcal
