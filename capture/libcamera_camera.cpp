// SPDX-License-Identifier: BSD-3-Clause
#include "capture/libcamera_camera.h"

#include <libcamera/control_ids.h>
#include <libcamera/property_ids.h>

#include <utility>

#include "capture/libcamera.h"
#include "capture/libcamera_list.h"

namespace throwcal {
namespace {

/// What a camera goes on to change by itself.
std::vector<std::string> automatics_of(const libcamera::Camera& camera, bool is_wanted) {
  namespace controls = libcamera::controls;
  std::vector<std::string> out;
  if (!is_wanted) return out;
  const libcamera::ControlInfoMap& has = camera.controls();
  if (has.count(&controls::AeEnable)) out.push_back("exposure");
  if (has.count(&controls::AwbEnable)) out.push_back("white balance");
  if (has.count(&controls::AfMode)) out.push_back("focus");
  return out;
}

}  // namespace

std::unique_ptr<Camera> make_libcamera_camera(const CameraSource& source,
                                              const std::string& which) {
  return std::make_unique<LibcameraCamera>(source, which);
}

LibcameraCamera::LibcameraCamera(const CameraSource& source, const std::string& which)
    : LiveCamera(source, which.empty() ? "libcamera" : which), which_(which) {
  open_first();
}

void LibcameraCamera::open() {
  const auto camera = find_libcamera_camera(which_);
  const auto model = camera->properties().get(libcamera::properties::Model);
  const CameraIdentity found{camera->id(), model.value_or(""), {}, {}};
  place_ = camera->id();
  meet(found);
  const V4l2Request request{source_.model.width_px, source_.model.height_px, source_.colour,
                            source_.device};
  auto stream = std::make_unique<LibcameraStream>(camera, request);
  accept(found, stream->format());
  which_ = camera->id();  // a number may be another's tomorrow
  stream_ = std::move(stream);
  const std::lock_guard lock(mutex_);
  settings_.automatic = automatics_of(*camera, source_.device.picture.automatic);
}

void LibcameraCamera::close() {
  stream_.reset();
  is_streaming_ = false;
}

/// What a frame was taken with.
void LibcameraCamera::read_settings(const libcamera::ControlList& told) {
  namespace controls = libcamera::controls;
  PictureNumbers now;
  if (const auto us = told.get(controls::ExposureTime)) now.exposure_s = 1e-6 * *us;
  if (const auto gain = told.get(controls::AnalogueGain)) now.gain = *gain;
  if (const auto dioptres = told.get(controls::LensPosition)) now.focus = *dioptres;
  if (const auto kelvin = told.get(controls::ColourTemperature)) now.white_balance_k = *kelvin;
  const std::lock_guard lock(mutex_);
  static_cast<PictureNumbers&>(settings_) = now;
}

Camera::Outcome LibcameraCamera::next_of_stream(std::span<std::uint8_t> slot, Frame& frame) {
  if (!std::exchange(is_streaming_, true)) stream_->start();
  for (int idle = 0; idle < max_idle_wakes; ++idle) {
    switch (interrupted_.wait(stream_->fd(), patience)) {
      case EventFlag::Woken::by_flag:
        return Outcome::interrupted;
      case EventFlag::Woken::by_time:
        return lost(place_ + ": no frame for 2 s");
      case EventFlag::Woken::by_device:
      case EventFlag::Woken::by_event:
        break;
    }
    if (const auto picture = stream_->take()) return give(*picture, slot, frame);
  }
  return lost(place_ + ": wakes us without a frame");
}

Camera::Outcome LibcameraCamera::give(const LibcameraStream::Picture& given,
                                      std::span<std::uint8_t> slot, Frame& frame) {
  namespace controls = libcamera::controls;
  const libcamera::ControlList& told = given.request->metadata();
  read_settings(told);
  const double exposure_s = settings_.exposure_s.value_or(0.0);
  DriverStamp stamp{.stamp = {},
                    .source = TimestampSource::start_of_exposure,
                    .dequeued = given.completed,
                    .sequence = sequence_.extend(given.sequence)};
  if (const auto sensor_ns = told.get(controls::SensorTimestamp))
    stamp.stamp = from_boot_time(*sensor_ns, boot_clock_.suspended(), given.completed);
  clock_.set_exposure(exposure_s);
  const FrameClock::Moment moment = clock_.of(stamp);
  bool is_whole = false;
  if (!given.is_damaged) {
    given.pixels->begin_reading();
    is_whole = picture_->write(given.bytes, slot);
    given.pixels->end_reading();
  }
  try {
    stream_->give_back(given);
  } catch (const DeviceError& error) {
    broken_ = stream_error(error);
  }
  frame.sequence = stamp.sequence;
  frame.row0_mid_exposure = moment.row0_mid_exposure;
  fill(frame, moment, slot, exposure_s);
  return is_whole ? Outcome::frame : Outcome::damaged;
}

}  // namespace throwcal
