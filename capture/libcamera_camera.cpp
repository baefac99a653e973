// SPDX-License-Identifier: BSD-3-Clause
#include "capture/libcamera_camera.h"

#include <libcamera/control_ids.h>

#include <utility>

#include "capture/libcamera.h"
#include "capture/libcamera_list.h"
#include "capture/live_camera.h"

namespace throwcal {
namespace {

constexpr int max_idle_wakes = 10;

}  // namespace

std::unique_ptr<Camera> make_libcamera_camera(const CameraSource& source,
                                              const std::string& which) {
  return std::make_unique<LibcameraCamera>(source, which);
}

LibcameraCamera::LibcameraCamera(const CameraSource& source, const std::string& which)
    : source_(source), clock_(0, 0, 0) {
  try {
    const auto camera = find_libcamera_camera(which);
    id_ = camera->id();
    stream_ = std::make_unique<LibcameraStream>(camera, request());
  } catch (const std::runtime_error& error) {
    throw std::runtime_error("camera " + source_.name + ": " + error.what());
  }
  const V4l2Format& given = stream_->format();
  picture_.emplace(given, source_.colour);
  // What FrameDurationLimits asks for is what comes; who has no such control does as it likes.
  const libcamera::ControlList told = control_list(stream_->has(), controls());
  const auto limits_us = told.get(libcamera::controls::FrameDurationLimits);
  const double interval_s = limits_us ? 1e-6 * static_cast<double>((*limits_us)[0]) : 0.0;
  format_ = {given.width_px, given.height_px, picture_->format(),
             interval_s > 0 ? 1 / interval_s : 0.0};
  clock_ = {interval_s, 0.0, source_.model.row_time_s * source_.model.height_px};
}

V4l2Request LibcameraCamera::request() const {
  return {.width_px = source_.model.width_px,
          .height_px = source_.model.height_px,
          .frames_per_s = source_.v4l2.frames_per_s,
          .colour = source_.colour,
          .fourcc = source_.v4l2.fourcc,
          .input = {},
          .standard = {}};
}

/// Exposure and gain come here, once a source has them.
LibcameraControls LibcameraCamera::controls() const {
  return {.frames_per_s = source_.v4l2.frames_per_s, .exposure_s = {}, .gain = {}};
}

Camera::Outcome LibcameraCamera::lost(std::string why) {
  stream_.reset();
  is_streaming_ = false;
  error_ = std::move(why);
  return Outcome::lost;
}

bool LibcameraCamera::open() {
  try {
    auto stream = std::make_unique<LibcameraStream>(find_libcamera_camera(id_), request());
    RawPicture picture(stream->format(), source_.colour);
    if (picture.format() != format_.format) throw std::runtime_error(id_ + ": is another camera");
    stream_ = std::move(stream);
    picture_ = std::move(picture);
  } catch (const std::runtime_error& error) {
    error_ = error.what();
    return false;
  }
  sequence_.restart();
  clock_.restart();
  return true;
}

Camera::Outcome LibcameraCamera::next(std::span<std::uint8_t> slot, Frame& frame) {
  if (!stream_) {
    if (interrupted_.wait(-1, retry_period) == EventFlag::Woken::by_flag)
      return Outcome::interrupted;
    if (!open()) return Outcome::lost;
  }
  try {
    if (!std::exchange(is_streaming_, true)) stream_->start(controls());
    for (int idle = 0; idle < max_idle_wakes; ++idle) {
      switch (interrupted_.wait(stream_->fd(), patience)) {
        case EventFlag::Woken::by_flag:
          return Outcome::interrupted;
        case EventFlag::Woken::by_time:
          return lost(id_ + ": no frame for 2 s");
        case EventFlag::Woken::by_device:
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
  const double exposure_s = 1e-6 * told.get(controls::ExposureTime).value_or(0);
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
  stream_->give_back(given);
  frame.camera = source_.id;
  frame.sequence = stamp.sequence;
  frame.row0_mid_exposure = moment.row0_mid_exposure;
  frame.timestamp_source = moment.source;
  frame.time_sigma = moment.sigma;
  frame.row_time = from_seconds(source_.model.row_time_s);
  frame.exposure = from_seconds(exposure_s);
  frame.image = view_of(slot, format_);
  return is_whole ? Outcome::frame : Outcome::damaged;
}

}  // namespace throwcal
