// SPDX-License-Identifier: BSD-3-Clause
#include "capture/video_camera.h"

#include <cstdlib>
#include <filesystem>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <utility>

#include "capture/frame_times.h"

namespace throwcal {
namespace {

std::string size_text(int width, int height) {
  return std::to_string(width) + "x" + std::to_string(height);
}

/// A lens of which nothing is known: 53 degrees wide, as many are, and straight lines.
CameraModel nominal_model(int width_px, int height_px) {
  return {.width_px = width_px,
          .height_px = height_px,
          .fx_px = static_cast<double>(width_px),
          .fy_px = static_cast<double>(width_px),
          .cx_px = 0.5 * (width_px - 1),
          .cy_px = 0.5 * (height_px - 1)};
}

}  // namespace

VideoCamera::VideoCamera(const CameraSource& source, std::string path)
    : source_(source), path_(std::move(path)) {
  const std::string whose = "camera " + source_.name + ": ";
  if (!std::filesystem::is_regular_file(path_))
    throw std::runtime_error(whose + path_ + ": no such video file");
  setenv("OPENCV_FFMPEG_LOGLEVEL", "-8", 0);  // libraries do not log: what is wrong is thrown
  try {
    video_.open(path_, cv::CAP_FFMPEG);
  } catch (const cv::Exception&) {  // an unreadable file is told below
  }
  if (!video_.isOpened())
    throw std::runtime_error(whose + path_ + ": is not a video that can be read here");
  const Format has = format();
  if (source_.model.width_px == 0) source_.model = nominal_model(has.width_px, has.height_px);
  if (has.width_px != source_.model.width_px || has.height_px != source_.model.height_px)
    throw std::runtime_error(whose + path_ + ": pictures of " +
                             size_text(has.width_px, has.height_px) + " px; the rig says " +
                             size_text(source_.model.width_px, source_.model.height_px) + " px");
  times_path_ = std::filesystem::path(path_).replace_extension("timestamps.txt").string();
  has_times_ = std::filesystem::exists(times_path_);
  if (has_times_) times_ = read_frame_times(times_path_);
}

Camera::Format VideoCamera::format() const {
  return {static_cast<int>(video_.get(cv::CAP_PROP_FRAME_WIDTH)),
          static_cast<int>(video_.get(cv::CAP_PROP_FRAME_HEIGHT)),
          source_.colour ? PixelFormat::bgr : PixelFormat::grey, video_.get(cv::CAP_PROP_FPS)};
}

Camera::Outcome VideoCamera::failed(std::string why) {
  error_ = std::move(why);
  return Outcome::failed;
}

Camera::Outcome VideoCamera::next(std::span<std::uint8_t> slot, Frame& frame) {
  if (interrupted_) return Outcome::interrupted;
  try {
    if (!video_.read(picture_) || picture_.empty())
      return number_ ? Outcome::end : failed(path_ + ": holds no frame that can be read");
  } catch (const cv::Exception& e) {
    return failed(path_ + ", frame " + std::to_string(number_ + 1) + ": cannot be decoded (" +
                  e.err + ")");
  }
  const Format has = format();
  if (picture_.cols != has.width_px || picture_.rows != has.height_px || picture_.depth() != CV_8U)
    return failed(path_ + ", frame " + std::to_string(number_ + 1) + ": expected 8 bit, " +
                  size_text(has.width_px, has.height_px) + " px like the first");
  if (has_times_ && number_ >= times_.size())
    return failed(times_path_ + ": " + std::to_string(times_.size()) +
                  " times, but the video has more frames; expected a line for each");
  const int channels = source_.colour ? 3 : 1;
  cv::Mat picture(picture_.rows, picture_.cols, CV_8UC(channels), slot.data());
  if (picture_.channels() == channels)
    picture_.copyTo(picture);
  else  // the weights of grey sum to one: grey stays exact
    cv::cvtColor(picture_, picture, source_.colour ? cv::COLOR_GRAY2BGR : cv::COLOR_BGR2GRAY);

  const HostTime time = has_times_
                            ? times_[number_]
                            : HostTime(from_seconds(1e-3 * video_.get(cv::CAP_PROP_POS_MSEC)));
  if (number_ && time <= last_time_)
    return failed(path_ + ", frame " + std::to_string(number_ + 1) +
                  ": its time in the container is not after the frame before; give times in " +
                  times_path_);
  last_time_ = time;
  frame.camera = source_.id;
  frame.sequence = number_++;
  frame.row0_mid_exposure = time;
  frame.timestamp_source =
      has_times_ ? TimestampSource::start_of_exposure : TimestampSource::unknown;
  frame.row_time = from_seconds(source_.model.row_time_s);
  frame.exposure = frame.time_sigma = {};
  frame.image = {slot.data(), picture.cols, picture.rows, picture.step, has.format};
  return Outcome::frame;
}

}  // namespace throwcal
