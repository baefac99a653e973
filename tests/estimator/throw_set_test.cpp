// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/throw_set.h"

#include "tests/support/jacobian_check.h"

namespace throwcal {
namespace {

TEST(SightingModel, ItsJacobiansAreTheDerivativesForEveryKindOfShutter) {
  for (double row_time_s : {0.0, 20e-6}) {
    CameraModel model{.width_px = 1280,
                      .height_px = 720,
                      .fx_px = 900,
                      .fy_px = 890,
                      .cx_px = 630,
                      .cy_px = 350,
                      .distortion = {-0.2, 0.05, 1e-3, -1e-3, 0},
                      .row_time_s = row_time_s};
    const Rigid T_world_cam = look_at({0, 0, 1}, {4, 0.5, 1.3}, 0.03);
    const BallState ball{{4, 0.8, 1.5}, {1, -2, 3}};
    TimedSighting sighting{.camera = 1, .time_s = 0.0, .pixel = {500, 300}};
    const auto at = model_sighting(model, T_world_cam, ball, sighting);
    ASSERT_TRUE(at);
    Eigen::MatrixXd J(2, 10);
    J << at->J_position, at->J_camera;
    // Plain derivatives of the prediction, then the rolling shutter's decoupling on both.
    test::expect_jacobian(
        [&](const Eigen::VectorXd& d) {
          BallState moved = ball;
          moved.position_m += d.head<3>() + d[9] * ball.velocity_mps;
          const Rigid pose{exp_so3(d.segment<3>(6)) * T_world_cam.rotation,
                           T_world_cam.translation + d.segment<3>(3)};
          const Eigen::Vector2d predicted = *model.project(pose.inverse() * moved.position_m);
          Eigen::Matrix2d coupling = Eigen::Matrix2d::Identity();
          coupling.col(1) -= row_time_s * (Eigen::Vector2d(at->J_camera.col(6)));
          if (row_time_s > 0) {  // J_camera.col(6) is itself decoupled: speed' = C^-1 speed, so C =
                                 // I - rt speed e_v
            const Eigen::Vector2d decoupled_speed = at->J_camera.col(6);
            const double v = decoupled_speed.y() / (1 + row_time_s * decoupled_speed.y());
            const Eigen::Vector2d speed(decoupled_speed.x() * (1 - row_time_s * v), v);
            coupling = Eigen::Matrix2d::Identity();
            coupling.col(1) -= row_time_s * speed;
          }
          return Eigen::VectorXd(coupling.inverse() * predicted);
        },
        J, 1e-6, 1e-5);
  }
}

TEST(ThrowSet, SightingsOfAllCamerasStandInOrderOfTimeAndRowsCountInTheirTime) {
  RigDescription rig;
  rig.cameras = {{"a", {.fx_px = 1, .fy_px = 1, .row_time_s = 1e-5}, 0.5},
                 {"b", {.fx_px = 1, .fy_px = 1}, {}}};
  const auto at = [](CameraId k, int ms, double v) {
    return BallSighting{k,       HostTime(std::chrono::milliseconds(ms)),
                        {10, v}, 4 * Eigen::Matrix2d::Identity(),
                        {},      0};
  };
  const auto timed =
      time_throws(rig, {{"x", {{0, {at(0, 100, 200), at(0, 120, 0)}}, {1, {at(1, 101, 0)}}}}});
  ASSERT_EQ(timed.size(), 1u);
  ASSERT_EQ(timed[0].sightings.size(), 3u);
  EXPECT_EQ(timed[0].epoch, HostTime(std::chrono::milliseconds(110)));
  EXPECT_EQ(timed[0].sightings[0].camera, 1u);  // 101 ms; camera a's row 200 was read at 102 ms
  EXPECT_NEAR(timed[0].sightings[1].time_s, -0.008, 1e-12);
  EXPECT_NEAR(timed[0].sightings[1].whitening(0, 0), 2.0, 1e-12);  // the stated sigma, 0.5 px
  EXPECT_NEAR(timed[0].sightings[0].whitening(0, 0), 0.5, 1e-12);  // the detector's, 2 px
}

TEST(ThrowSet, AnEmptyThrowIsLeftOut) { EXPECT_TRUE(time_throws({}, {{"x", {}}}).empty()); }

}  // namespace
}  // namespace throwcal
