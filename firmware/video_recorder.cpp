// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/video_recorder.h"

#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>
#include <vector>

#include "firmware/decimal_time.h"
#include "firmware/input_error.h"
#include "firmware/text_file.h"

namespace throwcal {
namespace {

std::string timestamp_line(HostTime time) {
  // Milliseconds with nanosecond decimals: the decimal point of the seconds, three places on.
  const HostClock::duration thousandfold = time.time_since_epoch() * 1000;
  return to_decimal_seconds(HostTime(thousandfold)) + "\n";
}

}  // namespace

void record_video(Camera& camera, const std::filesystem::path& file,
                  const std::function<void(HostTime)>& filmed) {
  const Camera::Format format = camera.format();
  const bool grey = format.format == PixelFormat::grey;
  if (!grey && format.format != PixelFormat::bgr)
    throw InputError(file.string() + ": only grey and bgr pictures can be filmed");
  const cv::Size size(format.width_px, format.height_px);
  cv::VideoWriter video(file.string(), cv::CAP_FFMPEG, cv::VideoWriter::fourcc('F', 'F', 'V', '1'),
                        format.frames_per_s, size, !grey);
  if (!video.isOpened())
    throw InputError(file.string() +
                     ": can't be written; expected a folder that may be written "
                     "to and an OpenCV with FFmpeg's FFV1");
  std::vector<std::uint8_t> pixels(static_cast<std::size_t>(size.area()) * (grey ? 1 : 3));
  std::string timestamps = "# timestamp format v2\n";
  camera.start();
  Frame frame;
  Camera::Outcome outcome = camera.next(pixels, frame);
  for (; outcome == Camera::Outcome::frame; outcome = camera.next(pixels, frame)) {
    video.write(cv::Mat(size, grey ? CV_8UC1 : CV_8UC3, pixels.data()));
    timestamps += timestamp_line(frame.row0_mid_exposure);
    filmed(frame.row0_mid_exposure);
  }
  if (outcome == Camera::Outcome::failed)
    throw InputError("camera \"" + camera.name() + "\": " + camera.error());
  auto beside = file;
  write_text_file(beside.replace_extension(".timestamps.txt"), timestamps);
}

}  // namespace throwcal
