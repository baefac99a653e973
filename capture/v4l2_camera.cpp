// SPDX-License-Identifier: BSD-3-Clause
#include "capture/v4l2_camera.h"

#include <linux/videodev2.h>

#include <cerrno>
#include <utility>

#include "capture/usb_device.h"

namespace throwcal {
namespace {

/// In which a camera's automatics find what suits the light.
constexpr int settling_frames = 30;

/// What the driver says that its stamp names; `unknown` where it does not say on which clock it is.
TimestampSource source_of(std::uint32_t flags) {
  if ((flags & V4L2_BUF_FLAG_TIMESTAMP_MASK) != V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC)
    return TimestampSource::unknown;
  return (flags & V4L2_BUF_FLAG_TSTAMP_SRC_MASK) == V4L2_BUF_FLAG_TSTAMP_SRC_SOE
             ? TimestampSource::start_of_exposure
             : TimestampSource::end_of_frame;
}

}  // namespace

V4l2Camera::V4l2Camera(const CameraSource& source, std::string path)
    : LiveCamera(source, std::move(path)) {
  open_first();
}

void V4l2Camera::open() {
  auto stream = std::make_unique<V4l2Stream>(place_);
  meet(stream->identity());
  stream->configure({source_.model.width_px, source_.model.height_px, source_.colour,
                     source_.device, remembered_});
  const V4l2Format& given = stream->format();
  accept(stream->identity(), given);
  const double frame_s = given.frames_per_s > 0 ? 1 / given.frames_per_s : 0.0;
  field_interval_s_ = given.fields == Fields::progressive ? frame_s : frame_s / 2;
  frames_ = 0;
  stream_ = std::move(stream);
  adopt_settings();
}

void V4l2Camera::close() {
  stream_.reset();
  is_streaming_ = false;
  half_.reset();
}

/// What the camera's settings are now: told, believed by the clock, and given it again when it has
/// been away.
void V4l2Camera::adopt_settings() {
  const PictureSettings& now = stream_->controls().settings();
  if (!source_.device.picture.automatic) remembered_ = now;
  clock_.set_exposure(now.exposure_s.value_or(0.0));
  const std::lock_guard lock(mutex_);
  const int set_back = settings_.set_back;
  settings_ = now;
  settings_.set_back = set_back;
}

std::optional<UsbStream> V4l2Camera::usb_stream() const {
  const auto usb = usb_device_of(place_);
  if (!usb || !stream_) return std::nullopt;
  const V4l2Format& given = stream_->format();
  const double bytes = is_compressed(given.fourcc) ? 0.0 : static_cast<double>(given.least_bytes);
  return UsbStream{source_.name, usb->segment(), usb->speed_mbps(),
                   1e-6 * bytes * given.frames_per_s};
}

std::string V4l2Camera::stream_error(const DeviceError& error) const {
  if (error.code() != ENOSPC) return LiveCamera::stream_error(error);
  const auto usb = usb_stream();
  return place_ + ": " + (usb ? usb->segment : "its bus") +
         " has no room left for its pictures: " + usb_remedy;
}

/// Another program has changed something, perhaps.
void V4l2Camera::heed_event() {
  const bool was_changed = stream_->controls().restore();  // may take long: not under the lock
  const std::lock_guard lock(mutex_);
  settings_.set_back += was_changed;
}

Camera::Outcome V4l2Camera::next_of_stream(std::span<std::uint8_t> slot, Frame& frame) {
  if (const auto second = std::exchange(half_, std::nullopt))
    return give(*second, true, slot, frame);
  if (!std::exchange(is_streaming_, true)) stream_->start();
  const HostTime last_moment = now() + patience;
  for (int idle = 0; idle < max_idle_wakes;) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(last_moment - now());
    switch (interrupted_.wait(stream_->fd(), std::max(left, std::chrono::milliseconds(0)))) {
      case EventFlag::Woken::by_flag:
        return Outcome::interrupted;
      case EventFlag::Woken::by_time:
        return lost(place_ + ": no frame for 2 s; is its signal there?");
      case EventFlag::Woken::by_event:
        heed_event();
        if (now() > last_moment) ++idle;
        break;
      case EventFlag::Woken::by_device:
        ++idle;
    }
    if (const auto buffer = stream_->dequeue()) return take(*buffer, slot, frame);
  }
  return lost(place_ + ": reports an error without a name");
}

/// The picture is out of it and counts: that the driver can't take it back is told after it.
void V4l2Camera::give_back(const V4l2Stream::Buffer& buffer) {
  try {
    stream_->requeue(buffer);
  } catch (const DeviceError& error) {
    broken_ = stream_error(error);
  }
}

/// A buffer just dequeued: its number and its time.
Camera::Outcome V4l2Camera::take(const V4l2Stream::Buffer& buffer, std::span<std::uint8_t> slot,
                                 Frame& frame) {
  if (++frames_ == settling_frames) {
    stream_->controls().hold_the_rest();
    adopt_settings();
  }
  const Fields fields = stream_->format().fields;
  // Two alternating fields are one frame to the driver's counter.
  const bool is_next =
      fields != Fields::alternate || buffer.sequence != drivers_sequence_ || sequence_.is_new();
  drivers_sequence_ = buffer.sequence;
  if (is_next) number_ = sequence_.extend(buffer.sequence);
  moment_ = clock_.of({buffer.stamp, source_of(buffer.flags), now(), number_});
  if (buffer.is_damaged) {
    frame.sequence = fields == Fields::progressive ? number_ : 2 * number_ + 1;
    give_back(buffer);
    return Outcome::damaged;
  }
  if (fields == Fields::interlaced) half_ = buffer;
  return give(buffer, false, slot, frame);
}

Camera::Outcome V4l2Camera::give(const V4l2Stream::Buffer& buffer, bool is_second,
                                 std::span<std::uint8_t> slot, Frame& frame) {
  const V4l2Format& given = stream_->format();
  frame.sequence = number_;
  frame.row0_mid_exposure = moment_.row0_mid_exposure;
  bool is_whole = true;
  if (given.fields == Fields::progressive) {
    is_whole = picture_->write(buffer.bytes, slot);
  } else {
    const bool is_bottom =
        given.fields == Fields::alternate ? buffer.is_bottom : is_second == given.is_top_first;
    is_second = is_bottom == given.is_top_first;
    picture_->write_field(buffer.bytes, is_bottom, slot);
    frame.sequence = 2 * number_ + is_second;
    // A buffer of both fields has one stamp: that of the last line, or of the first.
    const bool is_stamps =
        moment_.source == TimestampSource::start_of_exposure ? !is_second : is_second;
    if (given.fields == Fields::interlaced && !is_stamps)
      frame.row0_mid_exposure += (is_second ? 1 : -1) * from_seconds(field_interval_s_);
  }
  if (!half_) give_back(buffer);
  fill(frame, moment_, slot, settings_.exposure_s.value_or(0.0));
  return is_whole ? Outcome::frame : Outcome::damaged;
}

}  // namespace throwcal
