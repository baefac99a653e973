// SPDX-License-Identifier: BSD-3-Clause
#include "capture/blobs.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>

namespace throwcal {
namespace {

cv::Mat empty() { return cv::Mat::zeros(50, 83, CV_8U); }

TEST(BlobFinder, MeasuresAreaCentroidAndMoments) {
  cv::Mat mask = empty();
  mask(cv::Rect(60, 20, 12, 6)) = 255;
  BlobFinder finder;
  const auto& blobs = finder.find(mask, 1);
  ASSERT_EQ(blobs.size(), 1u);
  EXPECT_EQ(blobs[0].area_px, 72);
  EXPECT_EQ(blobs[0].box, cv::Rect(60, 20, 12, 6));
  EXPECT_NEAR((blobs[0].centroid_px - Eigen::Vector2d(65.5, 22.5)).norm(), 0, 1e-9);
  EXPECT_NEAR(blobs[0].spread_px2(0, 0), (12 * 12 - 1) / 12.0, 1e-9);
  EXPECT_NEAR(blobs[0].spread_px2(1, 1), (6 * 6 - 1) / 12.0, 1e-9);
  EXPECT_NEAR(blobs[0].spread_px2(0, 1), 0, 1e-9);
}

TEST(BlobFinder, AgreesWithOpenCvOnADiscThatGrowsToTheLeft) {
  cv::Mat mask = empty();
  cv::circle(mask, {30, 25}, 11, 255, cv::FILLED);
  cv::line(mask, {30, 36}, {22, 46}, 255, 3);
  BlobFinder finder;
  const auto& blobs = finder.find(mask, 1);
  ASSERT_EQ(blobs.size(), 1u);
  const cv::Moments expected = cv::moments(mask, true);
  EXPECT_EQ(blobs[0].area_px, cv::countNonZero(mask));
  EXPECT_NEAR(blobs[0].centroid_px.x(), expected.m10 / expected.m00, 1e-9);
  EXPECT_NEAR(blobs[0].centroid_px.y(), expected.m01 / expected.m00, 1e-9);
  EXPECT_NEAR(blobs[0].spread_px2(0, 1), expected.mu11 / expected.m00, 1e-9);
  EXPECT_NEAR(blobs[0].spread_px2(0, 0), expected.mu20 / expected.m00, 1e-9);
}

TEST(BlobFinder, BridgesAGapOfOnePixelAndKeepsApartWhatIsFurther) {
  cv::Mat mask = empty();
  mask(cv::Rect(10, 10, 4, 4)) = 255;
  mask(cv::Rect(15, 10, 4, 4)) = 255;  // one column between
  mask(cv::Rect(10, 15, 4, 4)) = 255;  // one row between
  mask(cv::Rect(30, 10, 4, 4)) = 255;
  BlobFinder finder;
  EXPECT_EQ(finder.find(mask, 1).size(), 2u);
}

TEST(BlobFinder, JoinsTheArmsOfAVAtItsFoot) {
  cv::Mat mask = empty();
  cv::line(mask, {10, 5}, {25, 40}, 255);
  cv::line(mask, {40, 5}, {25, 40}, 255);
  BlobFinder finder;
  EXPECT_EQ(finder.find(mask, 1).size(), 1u);
}

TEST(BlobFinder, LeavesOutWhatIsSmallAndForgetsTheLastPicture) {
  cv::Mat mask = empty();
  mask.at<std::uint8_t>(0, 0) = mask.at<std::uint8_t>(49, 82) = 255;
  BlobFinder finder;
  EXPECT_EQ(finder.find(mask, 1).size(), 2u);
  EXPECT_TRUE(finder.find(mask, 2).empty());
  EXPECT_TRUE(finder.find(empty(), 1).empty());
}

}  // namespace
}  // namespace throwcal
