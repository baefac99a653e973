// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/ray_fit.h"

#include <numeric>

#include "tests/support/jacobian_check.h"
#include "tests/support/thrower.h"

namespace throwcal {
namespace {

/// One camera's rays of one throw, and unknowns a little off.
struct Rays {
  std::vector<TimedRay> rays;
  std::vector<bool> used;
  FlightUnknowns x;

  explicit Rays(double drag_per_m) {
    const auto scene = test::make_thrown({.throws = 1, .drag_per_m = drag_per_m});
    const std::vector<BallSighting>& seen = scene.throws[0].tracks[0].sightings;
    const HostTime middle = seen[seen.size() / 2].time;
    for (const BallSighting& s : seen)
      rays.push_back(*timed_ray(scene.rig.cameras[0].model, s, middle));
    used.assign(rays.size(), true);
    std::vector<std::size_t> all(rays.size());
    std::iota(all.begin(), all.end(), 0);
    x = *closed_form(rays, all, 9.80665);
    x.ball.position_m *= 1.0002;
  }

  /// Half the sum of squares after a step of the unknowns in the equations' order.
  Eigen::VectorXd half_cost(const Eigen::VectorXd& d) const {
    FlightUnknowns moved = x;
    moved.ball.position_m += d.head<3>(), moved.ball.velocity_mps += d.segment<3>(3);
    const double g = x.gravity.norm();
    moved.gravity = g * (x.gravity / g + tangents(x.gravity) * d.segment<2>(6)).normalized();
    if (x.drags) moved.drag += d[8];
    const auto squares = squared_residuals(rays, moved);
    return Eigen::VectorXd::Constant(1, 0.5 * std::accumulate(squares.begin(), squares.end(), 0.0));
  }
};

TEST(RayFit, TheGradientIsTheDerivativeOfTheCost) {
  const Rays of(0.0);
  const RayEquations normal = normal_equations({of.rays, of.used, 1.0, {}}, of.x, false);
  test::expect_jacobian([&](const Eigen::VectorXd& d) { return of.half_cost(d); },
                        normal.gradient.transpose(), 1e-7, 1e-5);
}

TEST(RayFit, WithDragTheGradientIsRightToAFewPerCent) {
  // To first order in drag, as ray_fit.cpp says: that slows the descent a little and moves no
  // solution, for the cost itself is exact.
  Rays of(0.0175);
  of.x.drags = true, of.x.drag = 0.0175;
  const RayEquations normal =
      normal_equations({of.rays, of.used, 1.0, {0.0175, 1e9, of.x.gravity, 0.0}}, of.x, false);
  test::expect_jacobian([&](const Eigen::VectorXd& d) { return of.half_cost(d); },
                        normal.gradient.transpose(), 1e-7, 0.05);
}

}  // namespace
}  // namespace throwcal
