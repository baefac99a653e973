// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/video_recorder.h"

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "firmware/decimal_time.h"
#include "firmware/input_error.h"
#include "firmware/text_file.h"

namespace throwcal {
namespace {

constexpr double nominal_frames_per_s =
    25.0;  ///< of a container; the times beside it are what counts

/// What must be free for a film to go on: enough to end all films of a box.
constexpr std::uintmax_t least_room_bytes = 8'000'000;
constexpr std::uint64_t frames_between_looks = 16;

/// cv::VideoWriter does not tell that a disk is full.
void expect_room(const std::filesystem::path& file) {
  std::error_code error;
  const auto space = std::filesystem::space(file, error);
  if (!error && space.available < least_room_bytes)
    throw InputError(file.string() + ": the disk is full");
}

std::string timestamp_line(HostTime time) {
  // Milliseconds with nanosecond decimals: the decimal point of the seconds, three places on.
  const HostClock::duration thousandfold = time.time_since_epoch() * 1000;
  return to_decimal_seconds(HostTime(thousandfold)) + "\n";
}

}  // namespace

cv::Mat picture_of(const Frame& frame, cv::Mat& memory) {
  const ImageView& image = frame.image;
  const auto view = [&](int rows, int type) {
    auto* data = const_cast<std::uint8_t*>(image.data);  // cv::Mat has no view of const
    return cv::Mat(rows, image.width_px, type, data, image.stride_bytes);
  };
  switch (image.format) {
    case PixelFormat::grey:
      return view(image.height_px, CV_8UC1);
    case PixelFormat::bgr:
      return view(image.height_px, CV_8UC3);
    case PixelFormat::yuyv:
      cv::cvtColor(view(image.height_px, CV_8UC2), memory, cv::COLOR_YUV2BGR_YUYV);
      return memory;
    case PixelFormat::nv12:
      cv::cvtColor(view(image.height_px + image.height_px / 2, CV_8UC1), memory,
                   cv::COLOR_YUV2BGR_NV12);
      return memory;
  }
  return {};
}

VideoFile::VideoFile(const std::filesystem::path& file, const Camera::Format& format)
    : file_(file),
      video_(file.string(), cv::CAP_FFMPEG, cv::VideoWriter::fourcc('F', 'F', 'V', '1'),
             format.frames_per_s > 0 ? format.frames_per_s : nominal_frames_per_s,
             cv::Size(format.width_px, format.height_px), format.format != PixelFormat::grey) {
  if (!video_.isOpened())
    throw InputError(file.string() +
                     ": can't be written; expected a folder that may be written "
                     "to and an OpenCV with FFmpeg's FFV1");
  auto beside = file_;
  timestamps_.open(beside.replace_extension(".timestamps.txt"));
  timestamps_ << "# timestamp format v2\n";
}

void VideoFile::write(const Frame& frame) {
  if (frames_++ % frames_between_looks == 0) expect_room(file_);
  video_.write(picture_of(frame, bgr_));
  // At once: of a film that a power cut ended, the times are worth as much as the pictures.
  timestamps_ << timestamp_line(frame.row0_mid_exposure) << std::flush;
  if (!timestamps_) throw InputError(file_.string() + ": its times can't be written");
}

void VideoFile::close() {
  video_.release();
  timestamps_.close();
}

void record_video(Camera& camera, const std::filesystem::path& file,
                  const std::function<void(HostTime)>& filmed) {
  const Camera::Format format = camera.format();
  VideoFile video(file, format);
  std::vector<std::uint8_t> pixels(static_cast<std::size_t>(format.width_px) * format.height_px *
                                   (format.format == PixelFormat::grey ? 1 : 3));
  camera.start();
  Frame frame;
  Camera::Outcome outcome = camera.next(pixels, frame);
  for (; outcome == Camera::Outcome::frame; outcome = camera.next(pixels, frame)) {
    video.write(frame);
    filmed(frame.row0_mid_exposure);
  }
  if (outcome == Camera::Outcome::failed)
    throw InputError("camera \"" + camera.name() + "\": " + camera.error());
  video.close();
}

}  // namespace throwcal
