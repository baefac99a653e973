// SPDX-License-Identifier: BSD-3-Clause
#include "capture/sphere_outline.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <numbers>

namespace throwcal {
namespace {

constexpr double diameter_m = 0.0657;

/// The outline's centroid, area and form by brute force: which sub-pixels' rays meet the sphere.
struct Counted {
  double area_px2 = 0;
  Eigen::Vector2d centroid_px = Eigen::Vector2d::Zero();
  Eigen::Matrix2d spread_px2 = Eigen::Matrix2d::Zero();
};
Counted count(const CameraModel& model, const Eigen::Vector3d& centre_m) {
  Counted out;
  const Eigen::Vector2d middle = *model.project(centre_m);
  constexpr double step_px = 0.3;
  for (double v = -24; v <= 24; v += step_px)
    for (double u = -24; u <= 24; u += step_px) {
      const Eigen::Vector2d off(u, v);
      const auto ray = model.unproject(middle + off);
      if (!ray || ray->cross(centre_m).norm() > 0.5 * diameter_m) continue;
      out.area_px2 += step_px * step_px;
      out.centroid_px += step_px * step_px * off;
      out.spread_px2 += step_px * step_px * off * off.transpose();
    }
  out.centroid_px /= out.area_px2;
  out.spread_px2 = out.spread_px2 / out.area_px2 - out.centroid_px * out.centroid_px.transpose();
  return out;
}

TEST(SphereOutline, IsThatOfEveryRayThatMeetsTheSphere) {
  const CameraModel model{.lens = Lens::radtan,
                          .width_px = 640,
                          .height_px = 480,
                          .fx_px = 480,
                          .fy_px = 482,
                          .cx_px = 322,
                          .cy_px = 238,
                          .distortion = {-0.12, 0.03, 3e-4, -2e-4, 0}};
  for (const Eigen::Vector3d& centre_m :
       {Eigen::Vector3d(0.5, 0.3, 0.9), Eigen::Vector3d(-0.4, 0.2, 1.2)}) {
    const Counted expected = count(model, centre_m);
    const double radius_px = std::sqrt(expected.area_px2 / std::numbers::pi);
    const auto outline = sphere_outline(model, diameter_m, *model.project(centre_m), radius_px);
    ASSERT_TRUE(outline);
    EXPECT_GT(outline->offset_px.norm(), 0.05) << "or this test shows nothing";
    EXPECT_LT((outline->offset_px - expected.centroid_px).norm(), 0.02) << "of counting, 0.01";
    EXPECT_NEAR(outline->shape.determinant(), 1.0, 1e-9);
    const Eigen::Matrix2d spread =
        0.25 * radius_px * radius_px * outline->shape * outline->shape.transpose();
    EXPECT_LT((spread - expected.spread_px2).norm(), 0.005 * expected.spread_px2.norm());
  }
}

TEST(SphereOutline, OnTheAxisIsACircleAboutTheCentre) {
  const CameraModel model{
      .width_px = 640, .height_px = 480, .fx_px = 500, .fy_px = 500, .cx_px = 320, .cy_px = 240};
  const auto outline = sphere_outline(model, diameter_m, {320, 240}, 12.0);
  ASSERT_TRUE(outline);
  EXPECT_LT(outline->offset_px.norm(), 1e-9);
  EXPECT_LT((outline->shape - Eigen::Matrix2d::Identity()).norm(), 1e-9);
}

}  // namespace
}  // namespace throwcal
