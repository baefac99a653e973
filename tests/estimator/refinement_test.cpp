// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/refinement.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "tests/support/jacobian_check.h"
#include "tests/support/true_solution.h"

namespace throwcal {
namespace {

using test::make_thrown;
using test::ThrowerSettings;
using test::Thrown;

Refinement refine_from_rough(const Thrown& thrown, std::uint64_t seed) {
  const auto timed = time_throws(thrown.rig, thrown.throws);
  return refine(thrown.rig, timed,
                test::rough_start(test::true_solution(thrown, timed), 0.05, 0.1, 0.3, seed));
}

/// Normalised error squared; adds its degrees of freedom.
double nees(const Thrown& thrown, const Refinement& at, double& freedom) {
  const Eigen::VectorXd error = test::rig_error(thrown, at.solution.rig);
  freedom += static_cast<double>(error.size());
  return error.dot(at.covariance.ldlt().solve(error));
}

TEST(Refinement, WithoutNoiseItReturnsToTheTruth) {
  ThrowerSettings s{.sigma_px = 1e-6,
                    .state_sigma = false,
                    .max_offset_s = 0.01,
                    .drag_per_m = 0.0175,
                    .estimate_drag = true};
  const Thrown thrown = make_thrown(s);
  const Refinement at = refine_from_rough(thrown, 3);
  EXPECT_LT(test::rig_error(thrown, at.solution.rig).cwiseAbs().maxCoeff(), 1e-6);
}

TEST(Refinement, ItsCovarianceIsHonest) {
  // Sum of N normalised squares over the seeds: chi-square, so its mean is 1 +- sqrt(2/N); N is
  // about 1100. 4 sigma.
  for (const bool stated : {true, false}) {
    double sum = 0.0, freedom = 0.0;
    for (std::uint64_t seed = 1; seed <= 40; ++seed) {
      const Thrown thrown = make_thrown({.seed = seed,
                                         .throws = 5,
                                         .state_sigma = stated,
                                         .max_offset_s = 0.015,
                                         .drag_per_m = 0.0175,
                                         .estimate_drag = true});
      sum += nees(thrown, refine_from_rough(thrown, seed), freedom);
    }
    EXPECT_NEAR(sum / freedom, 1.0, 4 * std::sqrt(2 / freedom)) << "sigma stated: " << stated;
  }
}

TEST(Refinement, GrossErrorsAreTakenOutAndOnlyThey) {
  const Thrown thrown = make_thrown({.throws = 6, .outlier_fraction = 0.03});
  const Refinement at = refine_from_rough(thrown, 1);
  int gated = 0, total = 0;
  for (const auto& used : at.weighting.used)
    for (char u : used) gated += !u, ++total;
  EXPECT_GT(gated, 0.015 * total);
  EXPECT_LT(gated, 0.05 * total);
  double freedom = 0;
  EXPECT_LT(nees(thrown, at, freedom) / freedom, 2.0);
}

TEST(Refinement, ChiSquareIsNearItsDegreesOfFreedom) {
  const Refinement at = refine_from_rough(make_thrown({.seed = 5}), 5);
  EXPECT_NEAR(at.chi2, at.degrees_of_freedom, 5 * std::sqrt(2.0 * at.degrees_of_freedom));
}

TEST(Refinement, ARollingShutterCostsNothing) {
  const Thrown thrown = make_thrown({.row_time_s = 20e-6});
  double freedom = 0;
  const double sum = nees(thrown, refine_from_rough(thrown, 1), freedom);
  EXPECT_LT(sum / freedom, 1 + 4 * std::sqrt(2 / freedom));
}

TEST(Refinement, DropsFromOneSpotLeaveADirectionUndetermined) {
  const Thrown thrown = make_thrown({.throws = 1, .vertical_drops = true});
  const auto timed = time_throws(thrown.rig, thrown.throws);
  const Refinement at = refine(thrown.rig, timed, test::true_solution(thrown, timed));
  const auto pose = at.layout.pose_covariance(1, at.solution.rig, at.covariance);
  const double variance = pose.bottomRightCorner<3, 3>().trace();
  EXPECT_TRUE(!at.undetermined.empty() || variance > 0.01);
}

TEST(Refinement, TheSameThrowsGiveTheSameBits) {
  const Thrown thrown = make_thrown({.seed = 9});
  const Refinement a = refine_from_rough(thrown, 2), b = refine_from_rough(thrown, 2);
  EXPECT_EQ(a.covariance, b.covariance);
  EXPECT_EQ(a.solution.rig.T_world_cam[1].rotation, b.solution.rig.T_world_cam[1].rotation);
}

TEST(NormalEquations, TheGradientIsTheDerivativeOfTheCost) {
  const Thrown thrown =
      make_thrown({.throws = 2, .max_offset_s = 0.01, .drag_per_m = 0.02, .estimate_drag = true});
  const auto timed = time_throws(thrown.rig, thrown.throws);
  const Solution at = test::true_solution(thrown, timed);
  Weighting weighting{{}, std::vector<double>(4, 1.0), 0.0};
  for (const auto& t : timed) weighting.used.emplace_back(t.sightings.size(), 1);
  const RigLayout layout(thrown.rig, at.rig);
  const NormalEquations normal = normal_equations(thrown.rig, timed, at, layout, weighting);
  const auto cost_at = [&](const Eigen::VectorXd& step) {
    Solution s = at;
    layout.apply(step.head(layout.size()), s.rig);
    for (std::size_t j = 0; j < s.balls.size(); ++j) {
      const auto own = step.segment<6>(layout.size() + 6 * static_cast<int>(j));
      s.balls[j].position_m += own.head<3>(), s.balls[j].velocity_mps += own.tail<3>();
    }
    return Eigen::VectorXd::Constant(
        1, cost(timed, claimed_residuals(thrown.rig, timed, s), weighting));
  };
  Eigen::MatrixXd gradient(1, layout.size() + 12);
  gradient << normal.gradient.transpose(), normal.balls[0].gradient.transpose(),
      normal.balls[1].gradient.transpose();
  test::expect_jacobian(cost_at, -2 * gradient, 1e-7, 1e-4);
}

TEST(NormalEquations, EliminatingTheBallsSolvesTheWholeSystem) {
  const Thrown thrown =
      make_thrown({.throws = 3, .max_offset_s = 0.01, .drag_per_m = 0.02, .estimate_drag = true});
  const auto timed = time_throws(thrown.rig, thrown.throws);
  const Solution at = test::rough_start(test::true_solution(thrown, timed), 0.01, 0.02, 0.05, 1);
  Weighting weighting{{}, std::vector<double>(4, 1.0), 0.0};
  for (const auto& t : timed) weighting.used.emplace_back(t.sightings.size(), 1);
  const RigLayout layout(thrown.rig, at.rig);
  const NormalEquations normal = normal_equations(thrown.rig, timed, at, layout, weighting);
  const int rig = layout.size(), size = rig + 6 * 3;
  Eigen::MatrixXd whole = Eigen::MatrixXd::Zero(size, size);
  Eigen::VectorXd gradient(size);
  whole.topLeftCorner(rig, rig) = normal.information, gradient.head(rig) = normal.gradient;
  for (int j = 0; j < 3; ++j) {
    const NormalEquations::Ball& ball = normal.balls[j];
    whole.block<6, 6>(rig + 6 * j, rig + 6 * j) = ball.information;
    whole.block(0, rig + 6 * j, rig, 6) = ball.coupling;
    whole.block(rig + 6 * j, 0, 6, rig) = ball.coupling.transpose();
    gradient.segment<6>(rig + 6 * j) = ball.gradient;
  }
  EXPECT_EQ((whole - whole.transpose()).norm(), 0.0);
  const ReducedEquations reduced = eliminate_balls(normal, 0.0);
  const Eigen::VectorXd step = reduced.information.ldlt().solve(reduced.gradient);
  Eigen::VectorXd all(size);
  all.head(rig) = step;
  for (int j = 0; j < 3; ++j) all.segment<6>(rig + 6 * j) = reduced.ball_step(normal, j, step);
  EXPECT_LT((whole * all - gradient).norm(), 1e-7 * gradient.norm());
}

}  // namespace
}  // namespace throwcal
