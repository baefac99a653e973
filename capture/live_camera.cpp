// SPDX-License-Identifier: BSD-3-Clause
#include "capture/live_camera.h"

#include <pthread.h>

#include <cstdio>
#include <utility>

#include "capture/grabber.h"

namespace throwcal {
namespace {

/// Between two attempts to open a camera that is lost.
constexpr std::chrono::milliseconds retry_period{250};

/// "640x480 YUYV at 30/s".
std::string mode_text(const V4l2Format& format) {
  char rate[32];
  std::snprintf(rate, sizeof rate, " at %.4g/s", format.frames_per_s);
  return size_text(static_cast<std::uint32_t>(format.width_px),
                   static_cast<std::uint32_t>(format.height_px)) +
         ' ' + fourcc_text(format.fourcc) + (format.frames_per_s > 0 ? rate : "");
}

/// A slot with a picture in it, tightly packed.
ImageView view_of(std::span<std::uint8_t> slot, const Camera::Format& format) {
  const std::size_t bytes_a_pixel = format.format == PixelFormat::bgr    ? 3
                                    : format.format == PixelFormat::yuyv ? 2
                                                                         : 1;  // of the first plane
  return {slot.data(), format.width_px, format.height_px,
          static_cast<std::size_t>(format.width_px) * bytes_a_pixel, format.format};
}

}  // namespace

/// Of a camera that is missing, the format holds whatever it will give.
LiveCamera::LiveCamera(const CameraSource& source, std::string place)
    : source_(source),
      place_(std::move(place)),
      clock_(0, 0, 0),
      format_{source.model.width_px, source.model.height_px,
              source.colour ? PixelFormat::bgr : PixelFormat::grey, source.device.frames_per_s} {}

void LiveCamera::open_first() {
  try {
    open();
    format_ = given_;  // and no more from now on: it sized the ring's slots
  } catch (const std::runtime_error& error) {
    if (!source_.may_be_missing || !may_pass(error))
      throw std::runtime_error("camera " + source_.name + ": " + error.what());
  }
}

void LiveCamera::start() {
  sched_param first{};
  first.sched_priority = 1;
  pthread_setschedparam(pthread_self(), SCHED_RR, &first);  // not allowed: then as everybody
  name_this_thread(name(), ".live");
}

CameraIdentity LiveCamera::identity() const {
  const std::lock_guard lock(mutex_);
  return identity_;
}

PictureSettings LiveCamera::settings() const {
  const std::lock_guard lock(mutex_);
  return settings_;
}

Camera::Outcome LiveCamera::next(std::span<std::uint8_t> slot, Frame& frame) {
  if (!is_open()) {
    if (interrupted_.wait(-1, retry_period) == EventFlag::Woken::by_flag)
      return Outcome::interrupted;
    try {
      open();
    } catch (const std::runtime_error& error) {
      return lost(open_error(error));
    }
  }
  if (const auto why = std::exchange(broken_, std::nullopt)) return lost(*why);
  try {
    return next_of_stream(slot, frame);
  } catch (const DeviceError& error) {
    return lost(stream_error(error));
  }
}

Camera::Outcome LiveCamera::lost(std::string why) {
  close();
  error_ = std::move(why);
  return Outcome::lost;
}

std::string LiveCamera::stream_error(const DeviceError& error) const {
  return error.is_gone() ? place_ + ": was unplugged" : error.what();
}

std::string LiveCamera::open_error(const std::runtime_error& error) const {
  const auto* device = dynamic_cast<const DeviceError*>(&error);
  if (!device || !device->is_gone()) return error.what();
  return place_ + (accepted_ ? ": was unplugged" : ": is not plugged in");
}

/// Whether somebody may put it right while the box runs: plug it in, or the right one.
bool LiveCamera::may_pass(const std::runtime_error& error) const {
  if (dynamic_cast<const WrongCamera*>(&error)) return true;
  const auto* device = dynamic_cast<const DeviceError*>(&error);
  return device && (device->is_gone() || device->is_busy());
}

void LiveCamera::meet(const CameraIdentity& found) {
  {
    const std::lock_guard lock(mutex_);
    identity_ = found;
  }
  CameraIdentity expected = accepted_.value_or(CameraIdentity{});
  if (!source_.device.model.empty()) expected.model = source_.device.model;
  if (!source_.device.serial.empty()) expected.serial = source_.device.serial;
  // Twins without serial numbers are told apart by their ports.
  const bool is_moved = accepted_ && accepted_->serial.empty() && accepted_->port != found.port;
  if ((expected.model.empty() || expected.model == found.model) &&
      (expected.serial.empty() || expected.serial == found.serial) && !is_moved)
    return;
  std::string whose;
  for (const NamedSerial& other : source_.others)
    if (other.serial == found.serial && !found.serial.empty())
      whose = ", which the rig file calls \"" + other.camera + "\": the cables are swapped";
  const auto port = [&](const std::string& text) { return is_moved ? " at " + text : ""; };
  throw WrongCamera(place_ + ": here is " + description(found) + port(found.port) + whose +
                    "; expected " + description(expected) + port(expected.port));
}

void LiveCamera::accept(CameraIdentity found, const V4l2Format& given) {
  RawPicture picture(given, source_.colour);
  if (accepted_ && picture.format() != given_.format)
    throw WrongCamera(place_ + ": gives other pixels than before");
  const bool is_interlaced = given.fields != Fields::progressive;
  const double frame_s = given.frames_per_s > 0 ? 1 / given.frames_per_s : 0.0;
  // The ring's slots are of this size; a device as it is set may come back with another.
  source_.model.width_px = given.width_px;
  source_.model.height_px = picture.height_px();
  given_ = {given.width_px, picture.height_px(), picture.format(),
            given.frames_per_s * (is_interlaced ? 2 : 1), is_interlaced};
  picture_ = std::move(picture);
  clock_ = FrameClock(frame_s, 0.0, source_.model.row_time_s * source_.model.height_px);
  sequence_.restart();
  found.mode = mode_text(given);
  accepted_ = found;
  const std::lock_guard lock(mutex_);
  identity_ = found;
}

void LiveCamera::fill(Frame& frame, const FrameClock::Moment& moment, std::span<std::uint8_t> slot,
                      double exposure_s) const {
  frame.camera = source_.id;
  frame.timestamp_source = moment.source;
  frame.time_sigma = moment.sigma;
  frame.row_time = from_seconds(source_.model.row_time_s);
  frame.exposure = from_seconds(exposure_s);
  frame.image = view_of(slot, given_);
}

}  // namespace throwcal
