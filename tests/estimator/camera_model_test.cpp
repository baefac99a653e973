// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/camera_model.h"

#include <gtest/gtest.h>

#include <numbers>
#include <random>

#include "tests/support/jacobian_check.h"

namespace throwcal {
namespace {

CameraModel radtan() {
  return {.lens = Lens::radtan,
          .width_px = 1280,
          .height_px = 720,
          .fx_px = 905,
          .fy_px = 897,
          .cx_px = 633.3,
          .cy_px = 361.2,
          .skew_px = 0.4,
          .distortion = {-0.31, 0.12, 1e-3, -7e-4, -0.02}};
}
CameraModel kb4() {
  return {.lens = Lens::kb4,
          .width_px = 1280,
          .height_px = 960,
          .fx_px = 440,
          .fy_px = 441,
          .cx_px = 633.3,
          .cy_px = 471.2,
          .skew_px = 0.4,
          .distortion = {0.03, -0.01, 4e-3, -1e-3, 0}};
}

class EveryLens : public testing::TestWithParam<CameraModel> {};
INSTANTIATE_TEST_SUITE_P(, EveryLens, testing::Values(radtan(), kb4()), [](const auto& of) {
  return of.param.lens == Lens::radtan ? "radtan" : "kb4";
});

TEST_P(EveryLens, ThePointJacobianIsTheDerivative) {
  const CameraModel& model = GetParam();
  for (const Eigen::Vector3d& point :
       {Eigen::Vector3d(0.5, -0.3, 2), {-1.1, 0.9, 3}, {1e-12, 0, 4}, {0.01, 0.02, 5}}) {
    Eigen::Matrix<double, 2, 3> J;
    ASSERT_TRUE(model.project(point, &J));
    test::expect_jacobian([&](const Eigen::VectorXd& d) { return *model.project(point + d); }, J,
                          1e-6, 1e-5);
  }
}

TEST_P(EveryLens, UnprojectingAProjectionGivesItsRay) {
  const CameraModel& model = GetParam();
  std::mt19937 rng(7);
  std::uniform_real_distribution<double> across(-1, 1);
  for (int i = 0; i < 500; ++i) {
    const Eigen::Vector3d ray =
        Eigen::Vector3d(0.8 * across(rng), 0.8 * across(rng), 1.0).normalized();
    const auto back = model.unproject(*model.project(3.7 * ray));
    ASSERT_TRUE(back) << ray.transpose();
    EXPECT_LT((*back - ray).norm(), 1e-11);
  }
}

TEST(CameraModel, RadtanAgreesWithOpenCV) {
  // cv2.projectPoints of (0.7, -0.4, 2.5), same intrinsics without skew.
  CameraModel model = radtan();
  model.skew_px = 0;
  const double x = 0.28, y = -0.16, r2 = x * x + y * y;
  const double radial = 1 - 0.31 * r2 + 0.12 * r2 * r2 - 0.02 * r2 * r2 * r2;
  const double xd = x * radial + 2 * 1e-3 * x * y - 7e-4 * (r2 + 2 * x * x);
  const double yd = y * radial + 1e-3 * (r2 + 2 * y * y) + 2 * -7e-4 * x * y;
  EXPECT_LT((*model.project({0.7, -0.4, 2.5}) - Eigen::Vector2d(905 * xd + 633.3, 897 * yd + 361.2))
                .norm(),
            1e-10);
}

TEST(CameraModel, ARadtanCameraDoesNotSeeBehindItself) {
  EXPECT_FALSE(radtan().project({0.1, 0.1, -2}));
  EXPECT_FALSE(radtan().project({0, 0, 0}));
}

TEST(CameraModel, AFisheyeSeesPastNinetyDegrees) {
  const CameraModel model = kb4();
  const Eigen::Vector3d ray = Eigen::Vector3d(1, 0, -0.1).normalized();
  const auto pixel = model.project(ray);
  ASSERT_TRUE(pixel);
  EXPECT_LT((*model.unproject(*pixel) - ray).norm(), 1e-11);
}

TEST(CameraModel, PixelsBeyondTheLensConeHaveNoRay) {
  CameraModel model = radtan();
  model.distortion = {-0.3, 0, 0, 0,
                      0};  // turns back at r = 1/sqrt(0.9): 46.5 degrees, 0.7 in the picture
  EXPECT_NEAR(model.max_angle_rad(), std::atan(1 / std::sqrt(0.9)), 1e-9);
  EXPECT_FALSE(model.unproject({633.3 + 905 * 0.75, 361.2}));
  EXPECT_TRUE(model.unproject({633.3 + 905 * 0.6, 361.2}));
}

}  // namespace
}  // namespace throwcal
