// SPDX-License-Identifier: BSD-3-Clause
#include "capture/v4l2_camera.h"

#include <linux/videodev2.h>

#include <algorithm>
#include <chrono>
#include <utility>

namespace throwcal {
namespace {

using namespace std::chrono_literals;

constexpr auto retry_period = 250ms;
constexpr auto patience = 2000ms;  ///< without a frame
constexpr int max_idle_wakes = 10;

HostTime now() {
  return HostTime(std::chrono::duration_cast<HostClock::duration>(
      std::chrono::steady_clock::now().time_since_epoch()));
}

/// What the driver says that its stamp names; `unknown` where it does not say on which clock it is.
TimestampSource source_of(std::uint32_t flags) {
  if ((flags & V4L2_BUF_FLAG_TIMESTAMP_MASK) != V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC)
    return TimestampSource::unknown;
  return (flags & V4L2_BUF_FLAG_TSTAMP_SRC_MASK) == V4L2_BUF_FLAG_TSTAMP_SRC_SOE
             ? TimestampSource::start_of_exposure
             : TimestampSource::end_of_frame;
}

/// Of the first plane.
std::size_t bytes_a_pixel(PixelFormat format) {
  if (format == PixelFormat::bgr) return 3;
  return format == PixelFormat::yuyv ? 2 : 1;
}

}  // namespace

V4l2Camera::V4l2Camera(const CameraSource& source, std::string path)
    : source_(source), path_(std::move(path)), clock_(0, 0, 0) {
  try {
    stream_ = std::make_unique<V4l2Stream>(path_, request());
  } catch (const std::runtime_error& error) {
    throw std::runtime_error("camera " + source_.name + ": " + error.what());
  }
  const V4l2Format& given = stream_->format();
  picture_.emplace(given, source_.colour);
  const double fields = given.fields == Fields::progressive ? 1.0 : 2.0;
  format_ = {given.width_px, picture_->height_px(), picture_->format(),
             fields * given.frames_per_s};
  clock_ = clock();
}

V4l2Request V4l2Camera::request() const {
  return {.width_px = source_.model.width_px,
          .height_px = source_.model.height_px,
          .frames_per_s = source_.v4l2.frames_per_s,
          .colour = source_.colour,
          .fourcc = source_.v4l2.fourcc,
          .input = source_.v4l2.input,
          .standard = source_.v4l2.standard};
}

FrameClock V4l2Camera::clock() const {
  const double frames_per_s = stream_->format().frames_per_s;
  const double interval_s = frames_per_s > 0 ? 1 / frames_per_s : 0.0;
  return {interval_s, 0.0, source_.model.row_time_s * source_.model.height_px};
}

Camera::Outcome V4l2Camera::lost(std::string why) {
  stream_.reset();
  is_streaming_ = false;
  half_.reset();
  error_ = std::move(why);
  return Outcome::lost;
}

bool V4l2Camera::open() {
  try {
    auto stream = std::make_unique<V4l2Stream>(path_, request());
    RawPicture picture(stream->format(), source_.colour);
    if (picture.format() != format_.format) throw std::runtime_error(path_ + ": is another camera");
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

Camera::Outcome V4l2Camera::next(std::span<std::uint8_t> slot, Frame& frame) {
  if (!stream_) {
    if (interrupted_.wait(-1, retry_period) == EventFlag::Woken::by_flag)
      return Outcome::interrupted;
    if (!open()) return Outcome::lost;
  }
  try {
    if (const auto second = std::exchange(half_, std::nullopt))
      return give(*second, true, slot, frame);
    if (!std::exchange(is_streaming_, true)) stream_->start();
    for (int idle = 0; idle < max_idle_wakes; ++idle) {
      switch (interrupted_.wait(stream_->fd(), patience)) {
        case EventFlag::Woken::by_flag:
          return Outcome::interrupted;
        case EventFlag::Woken::by_time:
          return lost(path_ + ": no frame for 2 s; is its signal there?");
        case EventFlag::Woken::by_device:
          break;
      }
      if (const auto buffer = stream_->dequeue()) return take(*buffer, slot, frame);
    }
    return lost(path_ + ": reports an error without a name");
  } catch (const DeviceError& error) {
    return lost(error.is_gone() ? path_ + ": was unplugged" : error.what());
  }
}

/// A buffer just dequeued: its number and its time.
Camera::Outcome V4l2Camera::take(const V4l2Stream::Buffer& buffer, std::span<std::uint8_t> slot,
                                 Frame& frame) {
  const Fields fields = stream_->format().fields;
  // Two alternating fields are one frame to the driver's counter.
  const bool is_next =
      fields != Fields::alternate || buffer.sequence != drivers_sequence_ || sequence_.is_new();
  drivers_sequence_ = buffer.sequence;
  if (is_next) number_ = sequence_.extend(buffer.sequence);
  moment_ = clock_.of({buffer.stamp, source_of(buffer.flags), now(), number_});
  if (buffer.is_damaged) {
    frame.sequence = fields == Fields::progressive ? number_ : 2 * number_ + 1;
    stream_->requeue(buffer);
    return Outcome::damaged;
  }
  if (fields == Fields::interlaced) half_ = buffer;
  return give(buffer, false, slot, frame);
}

Camera::Outcome V4l2Camera::give(const V4l2Stream::Buffer& buffer, bool is_second,
                                 std::span<std::uint8_t> slot, Frame& frame) {
  const V4l2Format& given = stream_->format();
  frame.camera = source_.id;
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
      frame.row0_mid_exposure += (is_second ? 1 : -1) * from_seconds(1 / format_.frames_per_s);
  }
  if (!half_) stream_->requeue(buffer);
  frame.timestamp_source = moment_.source;
  frame.time_sigma = moment_.sigma;
  frame.row_time = from_seconds(source_.model.row_time_s);
  frame.exposure = {};
  frame.image = {slot.data(), format_.width_px, format_.height_px,
                 static_cast<std::size_t>(format_.width_px) * bytes_a_pixel(format_.format),
                 format_.format};
  return is_whole ? Outcome::frame : Outcome::damaged;
}

}  // namespace throwcal
