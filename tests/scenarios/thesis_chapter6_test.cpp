// SPDX-License-Identifier: BSD-3-Clause
// Chapter 6 of the thesis, simulated cameras. One throw iteration of the thesis is one sweep here.
#include <gtest/gtest.h>

#include <numbers>

#include "tests/support/thesis_table.h"

namespace throwcal::test {
namespace {

constexpr double quarter_turn = std::numbers::pi / 2;
// "The process and observation noise variances are set to 0.002 m and 0.1 pixels": units say
// sigmas, and so read the noise alone makes 0.52 px in 6.4, where the thesis reports 0.52 and 0.50;
// as variances (0.045 m, 0.32 px) it would make 11 px.
constexpr double sigma_ball_m = 0.002, sigma_px = 0.1;

/// 6.1 to 6.3: cameras side by side, 0.2 m apart; the ball drops 1.8 m before them.
ThesisExperiment drop(std::string name) {
  ThesisExperiment e{.name = std::move(name)};
  e.truth << 0, 0, 0, 0, 0, 0.2, 0, 0;
  e.guess << 0.3, 0.3, 0.3, 0.3, 0.3, 0.3, 0.2, 0.2;
  const ThesisBall ball{{0, 0.25, 1.8}, {0, 0, 0}};
  e.throws = {{.truth = ball, .guess = ball}};
  e.is_parallel = e.is_drop = true;
  return e;
}

/// 6.4 and 6.5: at the corners of a 1.5 m square, axes perpendicular.
ThesisExperiment corner(std::string name, std::vector<ThesisThrow> throws) {
  ThesisExperiment e{.name = std::move(name)};
  e.truth << -0.2, -0.2, -quarter_turn, quarter_turn, quarter_turn, 1.5, 0.2, 1.5;
  e.guess << 0, 0, -1.5, 1.5, 1.5, 1, 0, 1;
  e.throws = std::move(throws);
  e.sigma_ball_m = sigma_ball_m, e.sigma_px = sigma_px;
  return e;
}

const ThesisThrow first{.truth = {{0.5, 0, 1}, {-1.2, 4, 1.2}},
                        .guess = {{0.7, 0.2, 0.7}, {-1, 3, 1}}};
const ThesisThrow second{.truth = {{-0.5, 0.25, 1.3}, {1.2, 3.5, 1.2}},
                         .guess = {{0, 0, 1}, {1, 2, 1}}};

TEST(ThesisChapter6, REkfOfADropWhoseStartIsKnown) {
  const EkfSettings known{.prior_ball_position_m = 1e-3, .prior_ball_velocity_mps = 1e-3};
  // Camera 1's figure is ?.6712e-4 in the scan: taken as the least it can be.
  ThesisResult thesis{.reprojection_px = {1.6712e-4, 0.0056}, .ball = {{0, 0.25, 1.8}, {}}};
  thesis.cameras << 0, 0, -0.0092, 0.0151, 0.0109, 0.1992, 0.0271, 0.0101;
  const auto c = compare(drop("6.1 R-EKF"), {Method::r_ekf, known}, thesis);
  expect_poses_not_above_thesis(c);
  expect_reprojection_not_above_thesis(c);
  EXPECT_EQ(c.full.accepted, 0);
}

TEST(ThesisChapter6, RbEkfOfADropWhoseStartIsKnown) {
  ThesisResult thesis{.reprojection_px = {0.0227, 0.0613}, .ball = {{0, 0.25, 1.8}, {}}};
  thesis.cameras << 0.0004, 0.0450, -0.0120, 0.0454, 0.0102, 0.2048, 0.0003, 0.0006;
  const auto c = compare(drop("6.2 RB-EKF"), {Method::rb_ekf}, thesis);
  expect_poses_not_above_thesis(c);
  expect_reprojection_not_above_thesis(c);
  EXPECT_EQ(c.full.accepted, 0);
}

/// 6.3: where the ball starts is a guess.
ThesisExperiment guessed_drop(std::string name) {
  ThesisExperiment e = drop(std::move(name));
  e.throws[0].guess = {{0, 0, 1.5}, {0, 0, 0}};
  e.sigma_ball_m = sigma_ball_m, e.sigma_px = sigma_px;
  return e;
}

TEST(ThesisChapter6, REkfOfADropWhoseStartIsGuessed) {
  ThesisResult thesis{.reprojection_px = {5.8282, 3.5549}, .ball = {{0, 0, 1.5}, {}}};
  thesis.cameras << 0.0015, 0.1916, -0.0125, 0.1263, 0.0318, 0.1852, -0.0683, -0.1170;
  const auto c = compare(guessed_drop("6.3 R-EKF"), {Method::r_ekf, let_go}, thesis);
  expect_poses_not_above_thesis(c);
  expect_reprojection_not_above_thesis(c);
}

TEST(ThesisChapter6, RbEkfOfADropWhoseStartIsGuessed) {
  ThesisResult thesis{.reprojection_px = {0.4822, 0.7799},
                      .ball = {{-0.0045, 0.1173, 2.1923}, {0.0379, -0.1758, -0.7339}}};
  thesis.cameras << 0.0193, 0.0828, 0.0194, 0.0824, -0.0223, 0.2345, -0.0021, 0.0053;
  const auto c = compare(guessed_drop("6.3 RB-EKF"), {Method::rb_ekf}, thesis);
  expect_poses_not_above_thesis(c);
  expect_reprojection_not_above_thesis(c);
  expect_least_squares(c);
  EXPECT_EQ(c.full.accepted, 0);
}

TEST(ThesisChapter6, RbEkfOfOneThrow) {
  ThesisResult thesis{.reprojection_px = {0.5177, 0.4998}};
  thesis.cameras << -0.1972, -0.2024, -1.5784, 1.5566, 1.5645, 1.4982, 0.1913, 1.4750;
  const auto c = compare(corner("6.4 RB-EKF", {first}), {}, thesis);
  expect_poses_not_above_thesis(c);
  expect_reprojection_not_above_thesis(c);
  expect_least_squares(c);
}

TEST(ThesisChapter6, RbEkfOfTheSecondThrow) {
  ThesisResult thesis{.reprojection_px = {0.5757, 0.5296}};
  thesis.cameras << -0.2044, -0.2116, -1.5650, 1.5647, 1.5707, 1.5171, 0.2302, 1.4952;
  const auto c = compare(corner("6.5 second", {second}), {}, thesis);
  expect_poses_not_above_thesis(c);
  expect_reprojection_not_above_thesis(c);
  expect_least_squares(c);
}

TEST(ThesisChapter6, RbEkfOfBothThrows) {
  ThesisResult thesis{.reprojection_px = {0.5006, 0.6152}};
  thesis.cameras << -0.1972, -0.2029, -1.5692, 1.5679, 1.5720, 1.5075, 0.2080, 1.5053;
  const auto c = compare(corner("6.5 both", {first, second}), {}, thesis);
  expect_poses_not_above_thesis(c);
  expect_reprojection_not_above_thesis(c);
  expect_least_squares(c);
}

}  // namespace
}  // namespace throwcal::test
