// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <atomic>
#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>
#include <string>
#include <vector>

#include "capture/camera_factory.h"

namespace throwcal {

/// A video file as a camera: every frame, its luma or colour, as fast as it is taken. Times are the
/// middle of row 0's exposure, from NAME.timestamps.txt beside NAME.mkv, or else the container's
/// own.
class VideoCamera : public Camera {
 public:
  /// A source whose model has no size gets a nominal lens of the video's. Throws
  /// std::runtime_error where the file cannot be read, its pictures have another size than the rig
  /// says, or its times are unusable.
  VideoCamera(const CameraSource& source, std::string path);

  const std::string& name() const override { return source_.name; }
  Format format() const override;
  CameraModel model() const override { return source_.model; }
  bool waits_for_reader() const override { return true; }
  void start() override {}
  Outcome next(std::span<std::uint8_t> slot, Frame& frame) override;
  void interrupt() override { interrupted_ = true; }
  std::string error() const override { return error_; }

 private:
  Outcome failed(std::string why);

  CameraSource source_;
  std::string path_, times_path_, error_;
  std::vector<HostTime> times_;
  bool has_times_ = false;
  cv::VideoCapture video_;
  cv::Mat picture_;
  std::uint64_t number_ = 0;
  HostTime last_time_ = HostTime::min();
  std::atomic<bool> interrupted_ = false;
};

}  // namespace throwcal
