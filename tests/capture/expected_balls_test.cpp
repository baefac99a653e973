// SPDX-License-Identifier: BSD-3-Clause
#include "capture/expected_balls.h"

#include <gtest/gtest.h>

namespace throwcal {
namespace {

constexpr double interval_s = 1.0 / 60;

/// A ball of 5 px (0.0657 m across: 152 px to the metre) thrown upwards.
BallOutline thrown(int frame) {
  const double t = frame * interval_s;
  return {{100 + 200 * t, 300 - 500 * t + 0.5 * 9.81 * 152 * t * t}, 5.0, {1, -3}};
}
HostTime time_of(int frame) { return HostTime(from_seconds(frame * interval_s)); }

TEST(ExpectedBalls, WhatFlewForThreeFramesIsExpectedInTheFourth) {
  ExpectedBalls expected(0.0657, 8);
  for (int frame = 0; frame < 3; ++frame) {
    EXPECT_TRUE(expected.at(time_of(frame)).empty());
    const KnownBall found[]{{thrown(frame)}, {{{400, 50}, 5.0, {0, 0}}}};  // something that stands
    expected.add(time_of(frame), found);
  }
  const auto& balls = expected.at(time_of(3));
  ASSERT_EQ(balls.size(), 2u);
  EXPECT_NEAR((balls[0].outline.centre_px - thrown(3).centre_px).norm(), 0, 1e-3);
  EXPECT_EQ(balls[0].outline.radius_px, 5.0);
  EXPECT_NEAR((balls[1].outline.centre_px - Eigen::Vector2d(400, 50)).norm(), 0, 1e-9);
}

TEST(ExpectedBalls, WhatJumpsGrowsOrIsFasterThanAThrowIsNot) {
  const struct {
    const char* what;
    KnownBall second, third;
  } cases[] = {
      {"a corner", {{{110, 300}, 5, {}}}, {{{110, 310}, 5, {}}}},
      {"a growing blob", {{{110, 300}, 9, {}}}, {{{120, 300}, 16, {}}}},
      {"70 m/s", {{{280, 300}, 5, {}}}, {{{460, 300}, 5, {}}}},
  };
  for (const auto& [what, second, third] : cases) {
    ExpectedBalls expected(0.0657, 8);
    const KnownBall first{{{100, 300}, 5, {}}};
    expected.add(time_of(0), {&first, 1});
    expected.add(time_of(1), {&second, 1});
    expected.add(time_of(2), {&third, 1});
    EXPECT_TRUE(expected.at(time_of(3)).empty()) << what;
  }
}

TEST(ExpectedBalls, WhatIsHiddenIsExpectedForFourFramesMore) {
  ExpectedBalls expected(0.0657, 8);
  for (int frame = 0; frame < 3; ++frame) {
    const KnownBall ball{thrown(frame)};
    expected.add(time_of(frame), {&ball, 1});
  }
  for (int frame = 3; frame < 9; ++frame) {
    const auto& balls = expected.at(time_of(frame));
    ASSERT_EQ(balls.size(), frame < 8 ? 1u : 0u) << frame;
    if (frame < 8) {
      EXPECT_NEAR((balls[0].outline.centre_px - thrown(frame).centre_px).norm(), 0, 0.01);
    }
    expected.add(time_of(frame), {});
  }
}

TEST(ExpectedBalls, ABallIsExpectedOnceHoweverManyWaysLedThere) {
  ExpectedBalls expected(0.0657, 8);
  for (int frame = 0; frame < 3; ++frame) {
    BallOutline beside = thrown(frame);
    if (frame < 2) beside.centre_px.x() += 1.5;
    const KnownBall found[]{{thrown(frame)}, {beside}};
    expected.add(time_of(frame), {found, frame < 2 ? 2u : 1u});
  }
  const auto& balls = expected.at(time_of(3));
  ASSERT_EQ(balls.size(), 1u);
  EXPECT_NEAR((balls[0].outline.centre_px - thrown(3).centre_px).norm(), 0, 1e-3);
}

TEST(ExpectedBalls, NothingIsExpectedAcrossMissingFrames) {
  ExpectedBalls expected(0.0657, 8);
  for (const int frame : {0, 1, 2}) {
    const KnownBall ball{thrown(frame)};
    expected.add(time_of(frame), {&ball, 1});
  }
  EXPECT_TRUE(expected.at(time_of(6)).empty());
  EXPECT_EQ(expected.at(time_of(3)).size(), 1u);
}

}  // namespace
}  // namespace throwcal
