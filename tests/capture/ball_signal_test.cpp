// SPDX-License-Identifier: BSD-3-Clause
#include "capture/ball_signal.h"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>
#include <utility>
#include <vector>

namespace throwcal {
namespace {

constexpr Colour yellow_green{215, 235, 90}, orange{235, 120, 40}, white{245, 245, 240};
constexpr int width = 64, height = 48;

cv::Vec3b bgr(const Colour& c) { return {c[2], c[1], c[0]}; }

/// A wall in two greys, one of them as bright as the ball, and the ball before their border.
cv::Mat scene(const Colour& ball) {
  const double luma = 0.299 * ball[0] + 0.587 * ball[1] + 0.114 * ball[2];
  cv::Mat picture(height, width, CV_8UC3, cv::Scalar::all(70));
  picture.colRange(width / 2, width) = cv::Scalar::all(std::round(luma));
  cv::circle(picture, {width / 2, height / 2}, 9, bgr(ball), cv::FILLED);
  return picture;
}

ImageView view(const cv::Mat& picture, PixelFormat format, int rows = height) {
  return {picture.data, width, rows, picture.step, format};
}

TEST(BallSignal, WithoutAColourItIsTheLuma) {
  const cv::Mat picture = scene(orange);
  cv::Mat grey;
  cv::cvtColor(picture, grey, cv::COLOR_BGR2GRAY);
  BallSignal signal(std::nullopt);
  EXPECT_EQ(cv::countNonZero(signal.of(view(picture, PixelFormat::bgr)) != grey), 0);
  EXPECT_EQ(signal.of(view(grey, PixelFormat::grey)).data, grey.data);
}

TEST(BallSignal, ABallAsBrightAsWhatIsBehindItStandsOutByItsColour) {
  for (const Colour& ball : {yellow_green, orange}) {
    BallSignal signal(ball);
    const cv::Mat out = signal.of(view(scene(ball), PixelFormat::bgr));
    const int centre = out.at<std::uint8_t>(height / 2, width / 2);
    for (const int x : {5, width - 5}) {
      EXPECT_GT(centre - out.at<std::uint8_t>(5, x), 60) << x;
    }
    // The greys, 100 levels and more apart, have come nearer to each other than to the ball.
    const int greys = std::abs(out.at<std::uint8_t>(5, 5) - out.at<std::uint8_t>(5, width - 5));
    EXPECT_LT(greys, centre - out.at<std::uint8_t>(5, width - 5));
  }
}

TEST(BallSignal, AWhiteBallHasOnlyItsLuma) {
  BallSignal signal(white);
  const cv::Mat out = signal.of(view(scene(white), PixelFormat::bgr));
  EXPECT_GT(out.at<std::uint8_t>(height / 2, width / 2), out.at<std::uint8_t>(5, 5) + 100);
}

// The same picture in the formats that cameras give; chroma has half the resolution there.
TEST(BallSignal, EveryFormatShowsTheSame) {
  cv::Mat picture = scene(yellow_green), yuv;
  cv::GaussianBlur(picture, picture, {0, 0}, 2.5);
  cv::cvtColor(picture, yuv, cv::COLOR_BGR2YUV);  // OpenCV's V comes first of none: Y, U, V
  BallSignal signal(yellow_green);
  const cv::Mat expected = signal.of(view(picture, PixelFormat::bgr)).clone();
  // OpenCV's chroma is scaled by 0.492 and 0.877; a camera's by 0.564 and 0.713 (BT.601).
  const auto chroma = [&](int x, int y, int channel) {
    const double value = yuv.at<cv::Vec3b>(y, x)[channel] - 128.0;
    return cv::saturate_cast<std::uint8_t>(128 +
                                           value * (channel == 1 ? 0.564 / 0.492 : 0.713 / 0.877));
  };
  cv::Mat yuyv(height, width, CV_8UC2), nv12(height * 3 / 2, width, CV_8UC1);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const std::uint8_t luma = yuv.at<cv::Vec3b>(y, x)[0];
      yuyv.at<cv::Vec2b>(y, x) = {luma, chroma(x / 2 * 2, y, x % 2 ? 2 : 1)};
      nv12.at<std::uint8_t>(y, x) = luma;
      if (x % 2 == 0 && y % 2 == 0) {
        nv12.at<std::uint8_t>(height + y / 2, x) = chroma(x, y, 1);
        nv12.at<std::uint8_t>(height + y / 2, x + 1) = chroma(x, y, 2);
      }
    }
  const auto most_apart = [&](const ImageView& image) {
    cv::Mat difference;
    cv::absdiff(signal.of(image), expected, difference);
    double most = 0;
    cv::minMaxLoc(difference, nullptr, &most);
    return most;
  };
  EXPECT_LE(most_apart(view(yuyv, PixelFormat::yuyv)), 6);
  EXPECT_LE(most_apart(view(nv12, PixelFormat::nv12)), 16);  // its rows are averaged, too
}

// Nothing beyond the frame's own bytes is read, which a sanitizer would tell.
TEST(BallSignal, PicturesOfOddSizesAndOfOnePixelHaveOne) {
  BallSignal signal(yellow_green);
  for (const auto& [w, h] : {std::pair{7, 5}, {1, 1}, {3, 1}, {1, 4}, {2, 2}}) {
    const auto pixels = static_cast<std::size_t>(w * h);
    const std::vector<std::uint8_t> packed(2 * pixels, 128), planar(pixels + (pixels + 1) / 2, 128);
    const auto stride = static_cast<std::size_t>(w);
    const cv::Mat of_packed =
        signal.of({packed.data(), w, h, 2 * stride, PixelFormat::yuyv}).clone();
    const cv::Mat of_planar = signal.of({planar.data(), w, h, stride, PixelFormat::nv12}).clone();
    ASSERT_EQ(of_packed.size(), cv::Size(w, h));
    ASSERT_EQ(of_planar.size(), cv::Size(w, h));
    EXPECT_EQ(cv::countNonZero(of_packed != of_planar), 0) << w << " x " << h;
  }
}

}  // namespace
}  // namespace throwcal
