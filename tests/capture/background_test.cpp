// SPDX-License-Identifier: BSD-3-Clause
#include "capture/background.h"

#include <gtest/gtest.h>

#include "capture/dice.h"

namespace throwcal {
namespace {

constexpr int width = 70, height = 40;  // no multiple of a vector
constexpr double sigma_grey = 2.5;

class BackgroundTest : public testing::Test {
 protected:
  bool show(double level, cv::Rect object = {}, double object_level = 0) {
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        const double grey = object.contains({x, y}) ? object_level : level;
        picture_.at<std::uint8_t>(y, x) =
            cv::saturate_cast<std::uint8_t>(grey + sigma_grey * dice_.normal());
      }
    const bool compared =
        background_.compare_and_learn(picture_, runs_) == Background::Outcome::compared;
    changed_.setTo(0);
    for (const PixelRun& run : runs_)
      changed_(cv::Rect(run.first, run.y, run.last - run.first + 1, 1)).setTo(255);
    return compared;
  }
  void learn(double level) {
    for (int n = 0; n < 60; ++n) show(level);
  }

  Dice dice_{5};
  cv::Mat picture_ = cv::Mat(height, width, CV_8U), changed_ = picture_.clone();
  std::vector<PixelRun> runs_;
  Background background_{width, height, 5.0};
};

TEST_F(BackgroundTest, LearnsLevelAndNoiseOfEachPixel) {
  learn(100);
  double mean = 0, sigma = 0;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      mean += background_.grey(x, y) / (width * height);
      sigma += background_.sigma_grey(x, y) / (width * height);
    }
  EXPECT_NEAR(mean, 100.0, 0.1);
  EXPECT_NEAR(sigma, sigma_grey, 0.15);
}

TEST_F(BackgroundTest, MarksWhatIsBrighterOrDarkerAndNoNoise) {
  learn(100);
  const cv::Rect object(10, 8, 20, 12);
  for (const double level : {140.0, 60.0}) {
    ASSERT_TRUE(show(100, object, level));
    EXPECT_EQ(cv::countNonZero(changed_(object)), object.area());
    EXPECT_LE(cv::countNonZero(changed_) - object.area(), 2);
  }
}

// A ball is in front of a pixel for some frames; then the background must be what it was.
TEST_F(BackgroundTest, DoesNotLearnABallThatPasses) {
  learn(100);
  const cv::Rect object(10, 8, 8, 8);
  for (int n = 0; n < 12; ++n) show(100, object, 200);
  EXPECT_NEAR(background_.grey(14, 12), 100.0, 5.0);
  for (int n = 0; n < 60; ++n) show(100);
  EXPECT_NEAR(background_.grey(14, 12), 100.0, 2.0);
}

TEST_F(BackgroundTest, FollowsTheLightAndInTheEndWhatWasPutDown) {
  learn(100);
  double level = 100;
  for (int n = 0; n < 200; ++n) {
    show(level += 0.1);
    ASSERT_LE(cv::countNonZero(changed_), 5) << "frame " << n;
  }
  const cv::Rect object(10, 8, 8, 8);
  for (int n = 0; n < 2500; ++n) show(level, object, 170);
  EXPECT_EQ(cv::countNonZero(changed_(object)), 0);
}

TEST_F(BackgroundTest, StartsAnewWhenTheWholePictureChanges) {
  learn(60);
  EXPECT_FALSE(show(160));
  int frames = 1;
  while (!show(160)) ++frames;
  EXPECT_LE(frames, 30);
  EXPECT_LE(cv::countNonZero(changed_), 2);
}

}  // namespace
}  // namespace throwcal
