// SPDX-License-Identifier: BSD-3-Clause
#include "capture/video_camera.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <opencv2/videoio.hpp>

#include "capture/dice.h"

namespace throwcal {
namespace {

constexpr int width = 64, height = 48, frames = 12;

/// A folder with a lossless video of noise: every grey level occurs.
class VideoCameraTest : public testing::TestWithParam<bool> {
 protected:
  VideoCameraTest() {
    std::filesystem::create_directories(folder_);
    Dice dice(1);
    cv::VideoWriter writer(path_, cv::VideoWriter::fourcc('F', 'F', 'V', '1'), 50.0,
                           {width, height}, GetParam());
    EXPECT_TRUE(writer.isOpened()) << "this OpenCV cannot write FFV1";
    for (int n = 0; n < frames; ++n) {
      cv::Mat grey(height, width, CV_8U), bgr;
      for (std::uint8_t& pixel : cv::Mat_<std::uint8_t>(grey))
        pixel = static_cast<std::uint8_t>(dice.bits());
      pictures_.push_back(grey);
      cv::merge(std::vector<cv::Mat>{grey, grey, grey}, bgr);
      writer.write(GetParam() ? bgr : grey);
    }
    source_.name = "north";
    source_.source = "video:" + path_;
    source_.model.width_px = width;
    source_.model.height_px = height;
    source_.model.row_time_s = 20e-6;
  }
  ~VideoCameraTest() override { std::filesystem::remove_all(folder_); }

  void write_times(int count) {
    std::ofstream file(folder_ / "north.timestamps.txt");
    file << "# timestamp format v2\n";
    for (int n = 0; n < count; ++n) file << 20 * n << ".000001\n";
  }
  std::string error_at_opening() const {
    try {
      make_camera(source_);
    } catch (const std::runtime_error& e) {
      return e.what();
    }
    return "none";
  }

  std::filesystem::path folder_ = std::filesystem::path(testing::TempDir()) /
                                  ("video_camera_test_" + std::to_string(GetParam()));
  std::string path_ = (folder_ / "north.mkv").string();
  std::vector<cv::Mat> pictures_;
  CameraSource source_;
  std::vector<std::uint8_t> slot_ = std::vector<std::uint8_t>(width * height);
  Frame frame_;
};
INSTANTIATE_TEST_SUITE_P(, VideoCameraTest, testing::Bool(),
                         [](const auto& of) { return of.param ? "colour" : "grey"; });

TEST_P(VideoCameraTest, GivesEveryPictureExactlyAtTheTimeBesideIt) {
  write_times(frames);
  const auto camera = make_camera(source_);
  camera->start();
  for (int n = 0; n < frames; ++n) {
    ASSERT_EQ(camera->next(slot_, frame_), Camera::Outcome::frame) << camera->error();
    EXPECT_EQ(cv::norm(pictures_[static_cast<std::size_t>(n)],
                       cv::Mat(height, width, CV_8U, slot_.data()), cv::NORM_INF),
              0.0);
    EXPECT_EQ(frame_.row0_mid_exposure.time_since_epoch().count(), n * 20'000'000LL + 1);
    EXPECT_EQ(frame_.sequence, static_cast<std::uint64_t>(n));
    EXPECT_EQ(frame_.row_time.count(), 20'000);
  }
  EXPECT_EQ(camera->next(slot_, frame_), Camera::Outcome::end);
}

TEST_P(VideoCameraTest, TakesTheContainersTimesWhereNoneStandBesideIt) {
  const auto camera = make_camera(source_);
  for (int n = 0; n < frames; ++n) {
    ASSERT_EQ(camera->next(slot_, frame_), Camera::Outcome::frame) << camera->error();
    EXPECT_NEAR(seconds(frame_.row0_mid_exposure.time_since_epoch()), 0.02 * n, 1e-3)
        << "Matroska keeps milliseconds";
  }
}

TEST_P(VideoCameraTest, SaysThatTimesAreTooFew) {
  write_times(frames - 3);
  const auto camera = make_camera(source_);
  for (int n = 0; n < frames - 3; ++n)
    ASSERT_EQ(camera->next(slot_, frame_), Camera::Outcome::frame);
  EXPECT_EQ(camera->next(slot_, frame_), Camera::Outcome::failed);
  EXPECT_EQ(camera->error(),
            (folder_ / "north.timestamps.txt").string() +
                ": 9 times, but the video has more frames; expected a line for each");
}

TEST_P(VideoCameraTest, SaysWhatIsWrongWithAFile) {
  source_.model.width_px = 640;
  EXPECT_EQ(error_at_opening(),
            "camera north: " + path_ + ": pictures of 64x48 px; the rig says 640x48 px");
  source_.source = "video:" + (folder_ / "south.mkv").string();
  EXPECT_EQ(error_at_opening(),
            "camera north: " + (folder_ / "south.mkv").string() + ": no such video file");
  std::ofstream(folder_ / "text.mkv") << "this is no video\n";
  source_.source = "video:" + (folder_ / "text.mkv").string();
  EXPECT_EQ(error_at_opening(), "camera north: " + (folder_ / "text.mkv").string() +
                                    ": is not a video that can be read here");
  source_.source = "webcam";
  EXPECT_EQ(error_at_opening(),
            "camera north: source \"webcam\" is unknown; expected \"simulated\", \"video:PATH\", "
            "\"v4l2:DEVICE\" or \"libcamera:ID\"");
}

}  // namespace
}  // namespace throwcal
