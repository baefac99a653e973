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

// A lamp, a cloud, a camera's own exposure: all pixels change by one factor, from one frame to the
// next, and a ball is still seen.
TEST_F(BackgroundTest, FollowsASuddenChangeOfLightAtOnce) {
  learn(100);
  const cv::Rect object(10, 8, 8, 8);
  for (const double level : {115.0, 80.0, 96.0}) {
    ASSERT_TRUE(show(level, object, level + 60));
    EXPECT_GE(cv::countNonZero(changed_(object)), object.area() - 1) << level;
    EXPECT_LE(cv::countNonZero(changed_) - object.area(), 12) << level;
    for (int n = 0; n < 5; ++n) show(level);
  }
}

// A pixel that shows leaves and sky by turns is restless: in the end only what is beyond both is
// marked. One that a ball passes now and then is not.
TEST_F(BackgroundTest, LearnsWhatIsRestless) {
  learn(100);
  const cv::Rect branch(40, 10, 12, 12), passed(10, 10, 8, 8);
  int marked = 0;
  for (int n = 0; n < 600; ++n) {
    if (n % 120 < 3)
      show(100, passed, 200);
    else
      show(100, n % 60 < 25 ? branch : cv::Rect(), 135);
    if (n >= 480) marked += cv::countNonZero(changed_(branch));
  }
  EXPECT_LT(marked, 0.1 * 50 * branch.area());
  EXPECT_GT(background_.unrest_grey(46, 16), 4.0);
  EXPECT_LT(background_.unrest_grey(14, 14), 0.5);
  show(100, branch, 220);
  EXPECT_EQ(cv::countNonZero(changed_(branch)), branch.area());
}

// Half a second is soon over: a branch is known after three swings, early on, but the mean has not
// followed it, nor what passed.
TEST_F(BackgroundTest, LearnsSoonWhatIsRestlessAtFirst) {
  for (int n = 0; n < 20; ++n) show(100);
  const cv::Rect branch(40, 10, 12, 12), passed(10, 10, 8, 8);
  int marked = 0;
  for (int n = 0; n < 150; ++n) {
    if (n % 50 == 20)
      show(100, passed, 200);
    else
      show(100, n % 30 < 12 ? branch : cv::Rect(), 125);
    if (n >= 120 && n % 30 < 12) marked += cv::countNonZero(changed_(branch));
  }
  EXPECT_LT(marked, 0.1 * 12 * branch.area());
  EXPECT_NEAR(background_.grey(46, 16), 100, 3);
  EXPECT_NEAR(background_.grey(14, 14), 100, 1);
  EXPECT_LT(background_.unrest_grey(14, 14), 1.0);
}

// Who stood there while the background was learnt must not leave a blind spot behind.
TEST_F(BackgroundTest, LearnsWithinSecondsWhatSomebodyStoodBefore) {
  const cv::Rect person(20, 5, 20, 30);
  for (int n = 0; n < 60; ++n) show(130, n < 30 ? person : cv::Rect(), 40);
  for (int n = 0; n < 140; ++n) show(130);
  EXPECT_NEAR(background_.grey(30, 20), 130, 3);
  for (int n = 0; n < 200; ++n) show(130);
  EXPECT_LT(background_.unrest_grey(30, 20), 1.0);
  const cv::Rect ball(28, 18, 6, 6);
  show(130, ball, 100);
  EXPECT_GE(cv::countNonZero(changed_(ball)), ball.area() - 1);
}

TEST_F(BackgroundTest, TellsAShakenDarkOrSaturatedPicture) {
  const auto show_stripes = [&](int shift) {
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        picture_.at<std::uint8_t>(y, x) = (x + shift) % 8 < 4 ? 60 : 140;
    return background_.compare_and_learn(picture_, runs_);
  };
  for (int n = 0; n < 40; ++n) show_stripes(0);
  EXPECT_FALSE(background_.is_shaken());
  EXPECT_EQ(show_stripes(1), Background::Outcome::compared);
  EXPECT_TRUE(background_.is_shaken());
  int frames = 1;  // a camera that was turned sees another picture: it is learnt
  while (show_stripes(1) == Background::Outcome::compared && frames < 100) ++frames;
  EXPECT_LT(frames, 20);
  for (int n = 0; n < 25; ++n) show_stripes(1);
  EXPECT_FALSE(background_.is_shaken());
  EXPECT_TRUE(runs_.empty());
  EXPECT_FALSE(background_.is_dark() || background_.is_saturated());
  show(2);
  EXPECT_TRUE(background_.is_dark());
  show(255);
  EXPECT_TRUE(background_.is_saturated());
}

TEST(Background, OfOnePixelIsAPictureToo) {
  Background background(1, 1, 5.0);
  const cv::Mat grey(1, 1, CV_8U, cv::Scalar(80)), white(1, 1, CV_8U, cv::Scalar(255));
  std::vector<PixelRun> runs;
  for (int n = 0; n < 40; ++n) background.compare_and_learn(grey, runs);
  EXPECT_TRUE(runs.empty());
  EXPECT_EQ(background.compare_and_learn(white, runs), Background::Outcome::learning);
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
