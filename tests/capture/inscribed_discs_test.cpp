// SPDX-License-Identifier: BSD-3-Clause
#include "capture/inscribed_discs.h"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

namespace throwcal {
namespace {

cv::Mat empty() { return cv::Mat::zeros(120, 90, CV_8U); }

/// A hand and the arm below it, as thick as a ball is wide.
cv::Mat arm() {
  cv::Mat mask = empty();
  cv::line(mask, {45, 60}, {55, 119}, 255, 11);
  cv::circle(mask, {45, 60}, 8, 255, cv::FILLED);
  return mask;
}

TEST(InscribedDiscs, ABallThatTouchesAHandIsARoundEnd) {
  cv::Mat mask = arm();
  cv::circle(mask, {45, 49}, 6, 255, cv::FILLED);
  InscribedDiscs finder;
  const auto& discs = finder.find(mask, 1.5);
  ASSERT_FALSE(discs.empty());
  EXPECT_NEAR((discs.front().centre_px - Eigen::Vector2d(45, 49)).norm(), 0, 1.5);
  EXPECT_NEAR(discs.front().radius_px, 6.3, 0.7);
  EXPECT_GT(discs.front().free_share, 0.6);
}

TEST(InscribedDiscs, AnArmHasNoneButItsEnds) {
  InscribedDiscs finder;
  for (const InscribedDisc& disc : finder.find(arm(), 1.5))
    EXPECT_TRUE(disc.centre_px.y() < 75 || disc.centre_px.y() > 105) << disc.centre_px.transpose();
}

TEST(InscribedDiscs, ARegionUpToThePicturesEdgeIsMeasuredAndNothingMarkedHasNone) {
  cv::Mat mask = empty();
  mask(cv::Rect(0, 0, 9, 9)) = 255;
  InscribedDiscs finder;
  const auto& discs = finder.find(mask, 1.5);
  ASSERT_EQ(discs.size(), 1u);
  EXPECT_NEAR((discs[0].centre_px - Eigen::Vector2d(4, 4)).norm(), 0, 1e-9);
  EXPECT_NEAR(discs[0].radius_px, 4.5, 0.2);
  EXPECT_TRUE(finder.find(empty(), 1.5).empty());
}

}  // namespace
}  // namespace throwcal
