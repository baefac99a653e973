// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <opencv2/videoio.hpp>
#include <string>

#include "capture/camera.h"

namespace throwcal {

/// A film of one camera, as `calibrate --video` reads it: FILE (lossless FFV1 in Matroska) and,
/// beside it, FILE's stem + ".timestamps.txt" (timestamp format v2, milliseconds: the middle of row
/// 0's exposure). Pictures with chroma of half the resolution become bgr.
class VideoFile {
 public:
  /// Throws InputError where it can't be written.
  VideoFile(const std::filesystem::path& file, const Camera::Format& format);
  /// Throws InputError where the disk is nearly full: what was filmed can still be closed.
  void write(const Frame& frame);
  void close();

 private:
  std::filesystem::path file_;
  cv::VideoWriter video_;
  std::ofstream timestamps_;
  std::uint64_t frames_ = 0;
  cv::Mat bgr_;
};

/// A frame's picture as OpenCV has it, CV_8UC1 or CV_8UC3 (bgr): a view, or in `memory`.
cv::Mat picture_of(const Frame& frame, cv::Mat& memory);

/// Films a camera until it ends. `filmed` is told each frame's time. Throws InputError where it
/// can't be written or the camera fails.
void record_video(Camera& camera, const std::filesystem::path& file,
                  const std::function<void(HostTime)>& filmed);

}  // namespace throwcal
