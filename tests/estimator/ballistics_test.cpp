// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/ballistics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tests/support/jacobian_check.h"

namespace throwcal {
namespace {

const Eigen::Vector3d gravity(0, 0, -9.80665);
const BallState start{{0.1, 0.2, 0.3}, {2.0, -1.0, 4.0}};

TEST(Ballistics, TheIntegratorAgreesWithTheClosedFormWithoutDrag) {
  for (double t : {-0.4, 0.0, 0.3, 1.1}) {
    const BallState closed = fly(start, t, gravity, 0.0),
                    integrated = propagate(start, t, gravity, 0.0).state;
    EXPECT_LT((closed.position_m - integrated.position_m).norm(), 1e-12);
    EXPECT_LT((closed.velocity_mps - integrated.velocity_mps).norm(), 1e-12);
  }
}

TEST(Ballistics, FlyingThereAndBackReturnsToTheStart) {
  const BallState there = fly(start, 0.9, gravity, 0.05), back = fly(there, -0.9, gravity, 0.05);
  EXPECT_LT((back.position_m - start.position_m).norm(), 1e-9);
  EXPECT_LT((back.velocity_mps - start.velocity_mps).norm(), 1e-9);
}

TEST(Ballistics, TheStepIsFineEnoughForAFastBallInThickAir) {
  // A table-tennis ball at 12 m/s, over a second: one call against a thousand.
  const BallState smash{{0, 0, 1}, {10, 0, 6.6}};
  BallState fine = smash;
  for (int i = 0; i < 1000; ++i) fine = fly(fine, 0.001, gravity, 0.12);
  EXPECT_LT((fly(smash, 1.0, gravity, 0.12).position_m - fine.position_m).norm(), 1e-6);
  BallState tennis = start;
  for (int i = 0; i < 1000; ++i) tennis = fly(tennis, 0.001, gravity, 0.0175);
  EXPECT_LT((fly(start, 1.0, gravity, 0.0175).position_m - tennis.position_m).norm(), 1e-8);
}

TEST(Ballistics, SensitivitiesAreTheDerivatives) {
  for (double drag : {0.0, 0.0175, 0.1}) {
    const Propagation p = propagate(start, 0.8, gravity, drag);
    Eigen::MatrixXd J(6, 4);
    J << p.J_position_velocity0, p.J_position_drag, p.J_velocity_velocity0, p.J_velocity_drag;
    test::expect_jacobian(
        [&](const Eigen::VectorXd& d) {
          BallState s = start;
          s.velocity_mps += d.head<3>();
          const Propagation moved = propagate(s, 0.8, gravity, drag + d[3]);
          Eigen::VectorXd out(6);
          out << moved.state.position_m, moved.state.velocity_mps;
          return out;
        },
        J);
  }
}

TEST(Ballistics, AFallingBallReachesItsTerminalVelocity) {
  // sqrt(g / k), where drag balances weight.
  EXPECT_NEAR(fly(start, 60.0, gravity, 0.02).velocity_mps.z(), -std::sqrt(9.80665 / 0.02), 1e-6);
}

TEST(Ballistics, AStillBallHasFiniteSensitivities) {
  EXPECT_TRUE(
      propagate({{0, 0, 2}, {0, 0, 0}}, 0.5, gravity, 0.0175).J_velocity_velocity0.allFinite());
}

TEST(Ballistics, ATennisBallsDragAtSeaLevel) {
  // rho 1.225 kg/m^3, C_d 0.47, A = pi/4 0.0657^2, m 0.0577: 1.225 * 0.47 * 0.0033902 / 0.1154.
  EXPECT_NEAR(sphere_drag_per_m(0.0657, 0.0577, 0.47, 0.0), 0.016914, 2e-5);
}

TEST(Ballistics, NormalGravityMatchesItsPublishedValues) {
  EXPECT_NEAR(normal_gravity_mps2(0.0, 0.0), 9.7803253359, 1e-9);                   // equator
  EXPECT_NEAR(normal_gravity_mps2(std::numbers::pi / 2, 0.0), 9.8321849378, 1e-8);  // pole
  EXPECT_NEAR(normal_gravity_mps2(std::numbers::pi / 4, 0.0), 9.8061977694, 1e-9);
  EXPECT_NEAR(normal_gravity_mps2(std::numbers::pi / 4, 1000.0) -
                  normal_gravity_mps2(std::numbers::pi / 4, 0.0),
              -3.086e-3, 5e-6);
}

}  // namespace
}  // namespace throwcal
