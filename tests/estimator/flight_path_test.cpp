// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/flight_path.h"

#include "tests/support/jacobian_check.h"

namespace throwcal {
namespace {

using Wants = FlightPath::Wants;
const Eigen::Vector3d gravity(0, 0, -9.80665);

TEST(FlightPath, ItIsTheIntegratedFlightInWhateverOrderItIsAsked) {
  const BallState start{{1, 2, 1.5}, {5, -8, 6}};  // 11 m/s
  for (double drag : {0.0, 0.0175, 0.12}) {
    FlightPath path(start, gravity, drag, Wants::state, false);
    for (double t : {0.31, -0.4, 0.0, 0.025, 0.9, -0.012, 0.5001}) {
      const BallState expected = fly(start, t, gravity, drag);
      const double fine = drag > 0.1 ? 5e-7 : 2e-8;  // metres
      EXPECT_LT((path.at(t).state.position_m - expected.position_m).norm(), fine) << t;
      EXPECT_LT((path.at(t).state.velocity_mps - expected.velocity_mps).norm(), 200 * fine) << t;
    }
  }
}

TEST(FlightPath, ItsSensitivitiesAreTheDerivatives) {
  const BallState start{{1, 2, 1.5}, {1, -2, 3}};
  for (double drag : {0.0, 0.0175})
    for (double t : {0.33, -0.41, 0.9}) {
      FlightPath path(start, gravity, drag, Wants::sensitivities, true);
      const Propagation at = path.at(t);
      Eigen::MatrixXd J(3, 4);
      J << at.J_position_velocity0, at.J_position_drag;
      test::expect_jacobian(
          [&](const Eigen::VectorXd& d) {
            return Eigen::VectorXd(
                fly({start.position_m, start.velocity_mps + d.head<3>()}, t, gravity, drag + d[3])
                    .position_m);
          },
          J, 1e-5, 1e-5);
    }
}

TEST(FlightPath, PastTheLongestFlightThereIsNoBall) {
  FlightPath path({{0, 0, 0}, {1, 0, 0}}, gravity, 0.01, Wants::state, false);
  EXPECT_FALSE(path.at(1e9).state.position_m.allFinite());
  EXPECT_TRUE(path.at(1.0).state.position_m.allFinite());
}

}  // namespace
}  // namespace throwcal
