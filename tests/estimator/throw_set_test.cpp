// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/throw_set.h"

#include <Eigen/Dense>

#include "tests/support/jacobian_check.h"

namespace throwcal {
namespace {

/// One camera somewhere, with every lens number to be estimated.
struct OneCamera {
  RigDescription rig;
  RigState state;
  BallState ball{{4, 0.8, 1.5}, {1, -2, 3}};
  TimedSighting sighting{.camera = 0, .row0_s = 0.0, .pixel = {500, 300}};

  OneCamera(Lens lens, double row_time_s) {
    CameraModel model{.lens = lens,
                      .width_px = 1280,
                      .height_px = 720,
                      .fx_px = 900,
                      .fy_px = 890,
                      .cx_px = 630,
                      .cy_px = 350,
                      .skew_px = 0.3,
                      .distortion = {-0.2, 0.05, 1e-3, -1e-3, 0},
                      .row_time_s = row_time_s};
    rig.cameras = {{"a", model, 0.2}};
    state = unplaced(rig);
    state.T_world_cam[0] = look_at({0, 0, 1}, {4, 0.5, 1.3}, 0.03);
    state.is_placed[0] = true;
  }

  /// Measured minus predicted with the ball where it is at the sighting's moment, which the
  /// camera's offset and row time move.
  Eigen::VectorXd plain_residual(const RigState& moved, const Eigen::Vector3d& ball_step) const {
    const double later_s = moment_s(moved, sighting) - moment_s(state, sighting);
    const Eigen::Vector3d at = ball.position_m + ball_step + later_s * ball.velocity_mps;
    return sighting.pixel - *moved.models[0].project(moved.T_world_cam[0].inverse() * at);
  }
};

TEST(SightingModel, ItsJacobiansAreTheDerivativesForEveryLensAndShutter) {
  for (Lens lens : {Lens::radtan, Lens::kb4})
    for (double row_time_s : {0.0, 20e-6}) {
      const OneCamera of(lens, row_time_s);
      SightingModel at;
      ASSERT_TRUE(model_sighting(of.state, of.ball, of.sighting, true, false, at));
      Eigen::MatrixXd J(2, 10 + intrinsics);
      J << at.J_position, -at.J_position, at.J_rotation, at.J_offset, at.J_lens;
      // The measured row is part of the time, so noise in v moves the prediction too: the model
      // divides that coupling out of the residual and of all its derivatives.
      SightingModel global = at;
      RigState frozen = of.state;
      frozen.models[0].row_time_s = 0.0;
      ASSERT_TRUE(model_sighting(frozen, of.ball, of.sighting, true, false, global));
      Eigen::Matrix2d coupling = Eigen::Matrix2d::Identity();
      coupling.col(1) -= row_time_s * global.J_offset;
      test::expect_jacobian(
          [&](const Eigen::VectorXd& d) {
            RigState moved = of.state;
            moved.T_world_cam[0].translation += d.segment<3>(3);
            moved.T_world_cam[0].rotation =
                exp_so3(d.segment<3>(6)) * moved.T_world_cam[0].rotation;
            moved.time_offset_s[0] += d[9];
            for (int i = 0; i < intrinsics; ++i)
              moved.models[0].at(static_cast<Intrinsic>(i)) += d[10 + i];
            return Eigen::VectorXd(-coupling.inverse() * of.plain_residual(moved, d.head<3>()));
          },
          J, 1e-6, 1e-5);
      EXPECT_LT((coupling * at.residual_px - of.plain_residual(of.state, {0, 0, 0})).norm(), 1e-9);
      EXPECT_LT((*residual_px(of.state, of.ball, of.sighting) - at.residual_px).norm(), 1e-12);
    }
}

TEST(RigLayout, ACamerasSliceHoldsWhatIsFreeAndItsJacobianIsTheDerivative) {
  OneCamera of(Lens::radtan, 20e-6);
  of.rig.cameras.push_back(of.rig.cameras[0]);
  of.rig.cameras[1].name = "b";
  of.rig.cameras[1].estimate = {Intrinsic::fx, Intrinsic::d1, Intrinsic::row_time};
  of.rig.ball.estimate_drag = true;
  const Rigid pose = of.state.T_world_cam[0];
  of.state = unplaced(of.rig);
  of.state.T_world_cam = {{look_at({0, 0, 0}, {4, 0, 0.4}, 0.05)}, pose};
  of.state.is_placed = {true, true};
  const RigLayout layout(of.rig, of.state);
  EXPECT_EQ(layout.size(), 2 + 10 + 1);
  EXPECT_EQ(*layout.drag(), 12);
  for (std::size_t k : {0u, 1u}) {
    of.sighting.camera = static_cast<CameraId>(k);
    SightingModel at;
    ASSERT_TRUE(model_sighting(of.state, of.ball, of.sighting, true, false, at));
    RigLayout::CameraJacobian J;
    layout.fill_jacobian(k, at, camera_one_turns(of.state.T_world_cam[0]), J);
    ASSERT_EQ(J.cols(), layout.camera(k).size);
    const auto predicted = [&](const Eigen::VectorXd& own) {
      RigState moved = of.state;
      Eigen::VectorXd step = Eigen::VectorXd::Zero(layout.size());
      step.segment(layout.camera(k).start, own.size()) = own;
      layout.apply(step, moved);
      const double later_s = moment_s(moved, of.sighting) - moment_s(of.state, of.sighting);
      const Eigen::Vector3d ball = of.ball.position_m + later_s * of.ball.velocity_mps;
      Eigen::Matrix2d coupling = Eigen::Matrix2d::Identity();
      RigState frozen = of.state;
      frozen.models[k].row_time_s = 0.0;
      SightingModel global;
      EXPECT_TRUE(model_sighting(frozen, of.ball, of.sighting, false, false, global));
      coupling.col(1) -= of.state.models[k].row_time_s * global.J_offset;
      return Eigen::VectorXd(coupling.inverse() *
                             *moved.models[k].project(moved.T_world_cam[k].inverse() * ball));
    };
    test::expect_jacobian(predicted, J, 1e-6, 1e-5);
  }
}

TEST(RigLayout, CameraOneTurnsWithoutLeavingItsHeading) {
  OneCamera of(Lens::radtan, 0.0);
  of.state.T_world_cam[0] = look_at({0, 0, 0}, {4, 0, 0.4}, 0.05);
  const RigLayout layout(of.rig, of.state);
  layout.apply(Eigen::Vector2d(0.2, -0.3), of.state);
  EXPECT_EQ(of.state.T_world_cam[0].translation.norm(), 0.0);
  EXPECT_NEAR(of.state.T_world_cam[0].rotation(1, 2), 0.0, 1e-15);
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
  EXPECT_NEAR(moment_s(unplaced(rig), timed[0].sightings[1]), -0.008, 1e-12);
  EXPECT_NEAR(timed[0].sightings[1].whitening(0, 0), 2.0, 1e-12);  // the stated sigma, 0.5 px
  EXPECT_NEAR(timed[0].sightings[0].whitening(0, 0), 0.5, 1e-12);  // the detector's, 2 px
}

TEST(ThrowSet, AnEmptyThrowIsLeftOut) { EXPECT_TRUE(time_throws({}, {{"x", {}}}).empty()); }

}  // namespace
}  // namespace throwcal
