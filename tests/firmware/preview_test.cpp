// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/preview.h"

#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

namespace throwcal {
namespace {

constexpr int brightness = 120;

/// A picture of one brightness whose other bytes (chroma) are not that.
cv::Mat luma_of(PixelFormat format, int width_px, int height_px) {
  std::vector<std::uint8_t> bytes(3u * width_px * height_px, brightness);
  ImageView image{bytes.data(), width_px, height_px, static_cast<std::size_t>(width_px), format};
  if (format == PixelFormat::yuyv) {
    image.stride_bytes *= 2;
    for (std::size_t i = 1; i < bytes.size(); i += 2) bytes[i] = 30;
  }
  if (format == PixelFormat::bgr) image.stride_bytes *= 3;
  return small_luma(image);
}

cv::Mat decoded(const Preview& preview) {
  const std::vector<std::uint8_t> bytes(preview.jpeg.begin(), preview.jpeg.end());
  return cv::imdecode(bytes, cv::IMREAD_UNCHANGED);
}

BallSighting ball(double u, double v, double radius) {
  BallSighting out;
  out.center_px = {u, v};
  out.radius_px = radius;
  return out;
}

TEST(Preview, IsTheLumaOfEveryFormat) {
  for (const auto format :
       {PixelFormat::grey, PixelFormat::yuyv, PixelFormat::nv12, PixelFormat::bgr}) {
    const cv::Mat luma = luma_of(format, 1280, 720);
    EXPECT_EQ(luma.size(), cv::Size(640, 360));
    EXPECT_EQ(luma.type(), CV_8UC1);
    EXPECT_EQ(cv::countNonZero(luma != brightness), 0) << static_cast<int>(format);
  }
}

TEST(Preview, IsAtMost640WideAndNeverLarger) {
  EXPECT_EQ(luma_of(PixelFormat::grey, 320, 240).size(), cv::Size(320, 240));
  EXPECT_EQ(luma_of(PixelFormat::grey, 641, 2).size(), cv::Size(640, 2));
  EXPECT_EQ(luma_of(PixelFormat::bgr, 4096, 3072).size(), cv::Size(640, 480));
  EXPECT_EQ(luma_of(PixelFormat::grey, 4096, 1).size(), cv::Size(640, 1));
  EXPECT_EQ(luma_of(PixelFormat::grey, 1, 4096).size(), cv::Size(1, 4096));
}

TEST(Preview, HasARingRoundEachBallAndNothingElse) {
  cv::Mat luma(240, 320, CV_8UC1, cv::Scalar(brightness));
  const Preview preview =
      make_preview(luma, 0.5, std::vector{ball(200.5, 100.5, 20), ball(500.5, 300.5, 2)});
  EXPECT_EQ(preview.balls, "100.0,50.0 250.0,150.0");
  const cv::Mat seen = decoded(preview);
  ASSERT_EQ(seen.size(), cv::Size(320, 240));
  EXPECT_GT(seen.at<std::uint8_t>(50, 100 + 14), brightness + 60) << "radius 10 and the gap of 4";
  EXPECT_GT(seen.at<std::uint8_t>(150 - 7, 250), brightness + 60) << "a small ball's ring is 7";
  EXPECT_NEAR(seen.at<std::uint8_t>(50, 100), brightness, 5) << "the ball itself is left alone";
  EXPECT_NEAR(seen.at<std::uint8_t>(200, 40), brightness, 5);
}

TEST(Preview, ABallOutsideThePictureHurtsNobody) {
  cv::Mat luma(24, 32, CV_8UC1, cv::Scalar(brightness));
  const Preview preview = make_preview(luma, 1, std::vector{ball(-1e5, 1e5, 1e4), ball(31, 0, 3)});
  EXPECT_EQ(decoded(preview).size(), cv::Size(32, 24));
}

}  // namespace
}  // namespace throwcal
