// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/picture.h"

#include <gtest/gtest.h>

#include "estimator/calibrate.h"
#include "tests/support/thrower.h"

namespace throwcal {
namespace {

int count(const std::string& text, const std::string& what) {
  int n = 0;
  for (std::size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + 1)) ++n;
  return n;
}

TEST(Picture, EveryCameraIsNamedAndEveryFlightIsDrawnInItsColour) {
  const test::Thrown thrown = test::make_thrown({.throws = 3});
  const std::string svg = to_svg(calibrate(thrown.rig, thrown.throws));
  for (const CameraDescription& camera : thrown.rig.cameras)
    EXPECT_EQ(count(svg, ">" + camera.name + "<"), 1);
  EXPECT_EQ(count(svg, "stroke-width=\"2.5\""), 3);
  EXPECT_EQ(count(svg, "nan"), 0);
  EXPECT_EQ(count(svg, "<svg"), 1);
  EXPECT_EQ(count(svg, "</svg>"), 1);
}

TEST(Picture, ACalibrationWithoutPosesIsAnEmptySheetAndNamesAreEscaped) {
  const std::string empty = to_svg(calibrate(test::make_thrown({}).rig, {}));
  EXPECT_EQ(count(empty, "nan"), 0);
  EXPECT_EQ(count(empty, "inf"), 0);
  Calibration named;
  named.cameras.push_back(
      {.name = "a<b&c", .T_world_cam = Rigid{}, .covariance = {}, .sigma_time_offset_s = {}});
  EXPECT_EQ(count(to_svg(named), "a&lt;b&amp;c"), 1);
}

TEST(Picture, WhatIsBeyondTheHorizonIsLeftOut) {
  Calibration calibration;
  for (const double x : {0.0, 1e300})
    calibration.cameras.push_back({.name = x > 0 ? "far" : "near",
                                   .T_world_cam = Rigid{Eigen::Matrix3d::Identity(), {x, 0, 0}},
                                   .covariance = {},
                                   .sigma_time_offset_s = {}});
  ThrowEstimate endless;
  endless.end = HostTime(std::chrono::hours(1'000'000));
  calibration.throws = {endless};
  const std::string svg = to_svg(calibration);
  EXPECT_EQ(count(svg, ">near<"), 1);
  EXPECT_EQ(count(svg, ">far<"), 0);
  EXPECT_LT(svg.size(), 1'000'000u);
}

}  // namespace
}  // namespace throwcal
