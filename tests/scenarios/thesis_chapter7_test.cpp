// SPDX-License-Identifier: BSD-3-Clause
// Chapter 7 of the thesis, real cameras. It has no truth there, so its own final estimates stand
// for it: recordings are made of those, with 0.3 px of noise (the lens calibration's error), and
// started from its own guesses. Its errors are then the re-projection's only.
#include <gtest/gtest.h>

#include <numbers>

#include "tests/support/thesis_table.h"

namespace throwcal::test {
namespace {

constexpr double quarter_turn = std::numbers::pi / 2;

ThesisExperiment rig(std::string name, std::vector<ThesisThrow> throws) {
  ThesisExperiment e{.name = std::move(name)};
  e.throws = std::move(throws);
  e.sigma_px = 0.3;
  e.is_real = true;
  return e;
}

/// 7.3 and 7.4: the same recording of a drop, side by side, 0.5 m apart. The truth is what the
/// RB-EKF found; the start was measured by a ruler.
ThesisExperiment drop(std::string name) {
  ThesisExperiment e =
      rig(std::move(name), {{.truth = {{0.3040, 0.3238, 1.1714}, {-0.0446, -0.0441, -0.0233}},
                             .guess = {{0.25, 0.35, 1.10}, {0, 0, 0}}}});
  e.truth << -0.0459, 0.0265, -0.0015, 0.0220, -0.0105, 0.5142, -0.0266, -0.0071;
  e.guess << 0, 0, 0, 0, 0, 0.5, 0, 0;
  e.is_parallel = e.is_drop = true;
  return e;
}

TEST(ThesisChapter7, REkfOfADropWhoseStartIsMeasured) {
  ThesisResult thesis{.reprojection_px = {5.1617, 4.9738}, .ball = {{0.25, 0.35, 1.10}, {}}};
  thesis.cameras << -0.0191, 0.0160, 0.0106, 0.0145, 0.0083, 0.4916, -0.0054, -0.0162;
  const auto c = compare(drop("7.3 R-EKF"), {Method::r_ekf, let_go}, thesis);
  expect_poses_not_above_thesis(c);
  expect_reprojection_not_above_thesis(c);
}

TEST(ThesisChapter7, RbEkfOfADrop) {
  const ThesisExperiment e = drop("7.4 RB-EKF");
  const auto c = compare(e, {}, {e.truth, {0.1448, 0.2693}, e.throws[0].truth});
  expect_reprojection_not_above_thesis(c);
  expect_least_squares(c);
  EXPECT_EQ(c.full.accepted, 0);
}

TEST(ThesisChapter7, ParallelCameras) {
  ThesisExperiment e =
      rig("7.5 RB-EKF", {{.truth = {{0.0355, 0.0733, 0.8864}, {1.1149, 1.8869, 0.7419}},
                          .guess = {{-0.25, 0, 1}, {1, 2, 1}}}});
  e.truth << -0.0091, 0.0120, -0.1212, 0.0503, 0.1260, 0.5158, 0.0408, -0.0126;
  e.guess << 0.5, 0.5, 0.5, 0.5, 0.5, 0, 0.5, 0.5;
  e.is_parallel = true;
  const auto c = compare(e, {}, {e.truth, {0.4009, 1.3721}});
  expect_reprojection_not_above_thesis(c);
  expect_least_squares(c);
}

TEST(ThesisChapter7, PerpendicularCameras) {
  ThesisExperiment e =
      rig("7.6 RB-EKF", {{.truth = {{-0.3618, -0.1101, 0.8088}, {1.4191, 2.5723, 0.5942}},
                          .guess = {{-1, 0.5, 1}, {1, 2, 1}}}});
  e.truth << -0.0115, -0.0010, -1.4995, 1.6111, 1.5774, 1.0100, 0.0662, 1.0005;
  e.guess << 0, 0, -quarter_turn, quarter_turn, quarter_turn, 1, 0, 1;
  const auto c = compare(e, {}, {e.truth, {0.3181, unreadable}});
  expect_reprojection_not_above_thesis(c);
  expect_least_squares(c);
}

TEST(ThesisChapter7, ArbitraryCamerasOneOfWhichLosesTheTopOfTheFlight) {
  ThesisExperiment e =
      rig("7.7 RB-EKF", {{.truth = {{-0.2721, 0.1341, 0.6719}, {0.7714, 3.2010, 0.4417}},
                          .guess = {{-1, 0.5, 1}, {1, 2, 1}}}});
  e.truth << -0.3754, -0.3214, -1.3230, 1.1549, 1.3321, 0.8160, 0.4710, 0.7604;
  e.guess << 0, 0, -quarter_turn, quarter_turn, quarter_turn, 1, 0, 1;
  const auto c = compare(e, {}, {e.truth, {unreadable, 1.2239}});
  expect_reprojection_not_above_thesis(c);
  expect_least_squares(c);
}

TEST(ThesisChapter7, ThreeThrowsOneOfWhichACameraSawInNineFrames) {
  ThesisExperiment e =
      rig("7.8 RB-EKF", {{.truth = {{-0.2755, 0.1320, 0.6776}, {0.7798, 3.1949, 0.4577}},
                          .guess = {{-1, 0.5, 1}, {1, 2, 1}}},
                         {.truth = {{0.4228, 0.1714, 0.9674}, {-1.2062, 3.1798, -0.2982}},
                          .guess = {{1, 0.5, 1}, {-1, 2, -1}},
                          .most_in_camera2 = 9},
                         {.truth = {{-0.0309, 0.5113, 0.7266}, {0.5964, 0.8585, 1.1182}},
                          .guess = {{-1, 0.5, 1}, {1, 2, 1}}}});
  e.truth << -0.3795, -0.3144, -1.3250, 1.1665, 1.3336, 0.8276, 0.4712, 0.7828;
  e.guess << 0, 0, -quarter_turn, quarter_turn, quarter_turn, 1, 0, 1;
  const auto c = compare(e, {}, {e.truth, {unreadable, 1.5296}});
  expect_reprojection_not_above_thesis(c);
  expect_least_squares(c);
}

}  // namespace
}  // namespace throwcal::test
