// SPDX-License-Identifier: BSD-3-Clause
#include "capture/libcamera_camera.h"

#include <libcamera/control_ids.h>
#include <libcamera/property_ids.h>

#include <utility>

#include "capture/libcamera.h"
#include "capture/libcamera_list.h"
#include "capture/live_camera.h"

namespace throwcal {
namespace {

constexpr int max_idle_wakes = 10;

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
    : source_(source), id_(which), clock_(0, 0, 0) {
  format_ = widest_format(source_);
  try {
    open();
    const V4l2Format& given = stream_->format();
    format_ = {given.width_px, given.height_px, pixels_, given.frames_per_s};
  } catch (const std::runtime_error& error) {
    if (!source_.may_be_missing || !may_pass(error))
      throw std::runtime_error("camera " + source_.name + ": " + error.what());
  }
}

CameraIdentity LibcameraCamera::identity() const {
  const std::lock_guard lock(mutex_);
  return identity_;
}

PictureSettings LibcameraCamera::settings() const {
  const std::lock_guard lock(mutex_);
  return settings_;
}

Camera::Outcome LibcameraCamera::lost(std::string why) {
  stream_.reset();
  is_streaming_ = false;
  error_ = std::move(why);
  return Outcome::lost;
}

/// Throws where it can't be had, or is another camera than is wanted or was here before.
void LibcameraCamera::open() {
  const auto camera = find_libcamera_camera(id_);
  const auto model = camera->properties().get(libcamera::properties::Model);
  CameraIdentity found{camera->id(), model.value_or(""), {}, {}};
  tell(found);
  check_identity(camera->id(), found, source_, accepted_);
  const V4l2Request request{source_.model.width_px, source_.model.height_px, source_.colour,
                            source_.device};
  auto stream = std::make_unique<LibcameraStream>(camera, request);
  const V4l2Format& given = stream->format();
  RawPicture picture(given, source_.colour);
  if (accepted_ && picture.format() != pixels_)
    throw WrongCamera(id_ + ": gives other pixels than before");
  pixels_ = picture.format();
  // The ring's slots are of this size; a camera as it is set may come back with another.
  source_.model.width_px = given.width_px;
  source_.model.height_px = given.height_px;
  id_ = camera->id();  // a number may be another's tomorrow
  found.mode = mode_text(given);
  accepted_ = found;
  automatic_ = automatics_of(*camera, source_.device.picture.automatic);
  tell(found);
  stream_ = std::move(stream);
  picture_ = std::move(picture);
  sequence_.restart();
  clock_ = {given.frames_per_s > 0 ? 1 / given.frames_per_s : 0.0, 0.0,
            source_.model.row_time_s * source_.model.height_px};
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

void LibcameraCamera::tell(const CameraIdentity& found) {
  const std::lock_guard lock(mutex_);
  identity_ = found;
  settings_.automatic = automatic_;
}

Camera::Outcome LibcameraCamera::next(std::span<std::uint8_t> slot, Frame& frame) {
  if (!stream_) {
    if (interrupted_.wait(-1, retry_period) == EventFlag::Woken::by_flag)
      return Outcome::interrupted;
    try {
      open();
    } catch (const std::runtime_error& error) {
      return lost(open_error(id_.empty() ? "libcamera" : id_, error, accepted_.has_value()));
    }
  }
  if (const auto why = std::exchange(broken_, std::nullopt)) return lost(*why);
  try {
    if (!std::exchange(is_streaming_, true)) stream_->start();
    for (int idle = 0; idle < max_idle_wakes; ++idle) {
      switch (interrupted_.wait(stream_->fd(), patience)) {
        case EventFlag::Woken::by_flag:
          return Outcome::interrupted;
        case EventFlag::Woken::by_time:
          return lost(id_ + ": no frame for 2 s");
        case EventFlag::Woken::by_device:
        case EventFlag::Woken::by_event:
          break;
      }
      if (const auto picture = stream_->take()) return give(*picture, slot, frame);
    }
    return lost(id_ + ": wakes us without a frame");
  } catch (const DeviceError& error) {
    return lost(error.is_gone() ? id_ + ": was unplugged" : error.what());
  }
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
    broken_ = error.is_gone() ? id_ + ": was unplugged" : error.what();
  }
  frame.camera = source_.id;
  frame.sequence = stamp.sequence;
  frame.row0_mid_exposure = moment.row0_mid_exposure;
  frame.timestamp_source = moment.source;
  frame.time_sigma = moment.sigma;
  frame.row_time = from_seconds(source_.model.row_time_s);
  frame.exposure = from_seconds(exposure_s);
  frame.image = view_of(slot, format_.width_px, format_.height_px, pixels_);
  return is_whole ? Outcome::frame : Outcome::damaged;
}

}  // namespace throwcal
