// SPDX-License-Identifier: BSD-3-Clause
#include "capture/simulated_scene.h"

#include <gtest/gtest.h>

#include "estimator/ballistics.h"

namespace throwcal {
namespace {

constexpr double recording_s = 60.0;

TEST(SimulatedScene, IsTheSameForTheSameSeedAndAnotherForAnother) {
  const SimulatedScene one({.seed = 7}), same({.seed = 7}), other({.seed = 8});
  for (double time_s = 0; time_s < recording_s; time_s += 0.0371) {
    const auto a = one.ball_at(time_s), b = same.ball_at(time_s);
    ASSERT_EQ(a.has_value(), b.has_value());
    if (a) {
      EXPECT_EQ(a->position_world_m, b->position_world_m);
    }
  }
  EXPECT_EQ(one.time_offset_s(2), same.time_offset_s(2));
  EXPECT_NE(one.time_offset_s(2), other.time_offset_s(2));
}

TEST(SimulatedScene, HasTheContractsWorldFrame) {
  const SimulatedScene scene({.seed = 3});
  const Rigid first = scene.T_world_cam(0);
  EXPECT_LT(first.translation.norm(), 1e-12);
  EXPECT_NEAR(first.rotation(1, 2), 0.0, 1e-12) << "camera 1 looks along x";
  EXPECT_GT(first.rotation(0, 2), 0.9);
  EXPECT_EQ(scene.time_offset_s(0), 0.0);
}

TEST(SimulatedScene, TheBallLeavesTheHandWithoutAJump) {
  const SimulatedScene scene({.seed = 5});
  constexpr double step_s = 1e-6;
  for (const auto& arc : scene.arc_list(0, recording_s)) {
    if (arc.after_bounce) continue;
    const auto before = scene.ball_at(arc.start_s - step_s), after = scene.ball_at(arc.start_s);
    ASSERT_TRUE(before && after);
    EXPECT_TRUE(before->in_hand && !after->in_hand);
    const Eigen::Vector3d velocity = (after->position_world_m - before->position_world_m) / step_s;
    EXPECT_LT((velocity - arc.velocity_world_mps).norm(), 1e-3);
    EXPECT_TRUE(scene.hand_at(arc.start_s + 0.1).has_value()) << "the hand follows through";
  }
}

TEST(SimulatedScene, FliesAsArcListSaysAndBouncesOnTheGround) {
  const SimulatedScene scene({.seed = 5});
  const auto arcs = scene.arc_list(0, recording_s);
  EXPECT_GE(arcs.size(), 2 * 25u);
  for (const auto& arc : arcs) {
    const double middle_s = 0.5 * (arc.start_s + arc.end_s);
    const auto ball = scene.ball_at(middle_s);
    ASSERT_TRUE(ball);
    EXPECT_EQ(ball->after_bounce, arc.after_bounce);
    EXPECT_EQ(ball->throw_number, arc.number);
    const BallState expected =
        fly({arc.position_world_m, arc.velocity_world_mps}, middle_s - arc.start_s,
            {0, 0, -scene.rig().gravity_mps2}, scene.settings().drag_per_m);
    EXPECT_LT((ball->position_world_m - expected.position_m).norm(), 1e-9);
    if (arc.after_bounce) {
      EXPECT_NEAR(arc.position_world_m.z(), -1.2 + 0.033, 0.11);
      EXPECT_GT(arc.velocity_world_mps.z(), 2.0);
    } else {
      EXPECT_GT(arc.end_s - arc.start_s, 0.7);
    }
  }
}

TEST(SimulatedScene, EveryThrowIsWellSeenByThreeCamerasAtLeast) {
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    const SimulatedScene scene({.seed = seed});
    const RigDescription rig = scene.rig();
    for (const auto& arc : scene.arc_list(0, recording_s)) {
      if (arc.after_bounce) continue;
      int seen_well = 0;
      for (CameraId k = 0; k < rig.cameras.size(); ++k) {
        const Rigid T_cam_world = scene.T_world_cam(k).inverse();
        int frames = 0, seen = 0;
        for (double time_s = arc.start_s; time_s < arc.end_s; time_s += 1.0 / 60, ++frames) {
          const auto pixel =
              rig.cameras[k].model.project(T_cam_world * scene.ball_at(time_s)->position_world_m);
          seen += pixel && rig.cameras[k].model.contains(*pixel, 10.0);
        }
        seen_well += seen > 0.8 * frames;
      }
      EXPECT_GE(seen_well, 3) << "seed " << seed << ", throw " << arc.number;
    }
  }
}

}  // namespace
}  // namespace throwcal
