// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/refinement.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>

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

/// Normalised error squared per degree of freedom in the free directions.
double nees_per_freedom(const Thrown& thrown, const Refinement& at, double& freedom) {
  const Eigen::MatrixXd free = gauge_directions(thrown.rig, at.solution.rig);
  const Eigen::VectorXd error = (free.transpose() * free).inverse() * free.transpose() *
                                test::rig_error(thrown, at.solution.rig);
  const Eigen::MatrixXd pinv = (free.transpose() * free).inverse() * free.transpose();
  const Eigen::MatrixXd covariance = pinv * at.covariance * pinv.transpose();
  freedom += static_cast<double>(error.size());
  return error.dot(covariance.ldlt().solve(error));
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
    double nees = 0.0, freedom = 0.0;
    for (std::uint64_t seed = 1; seed <= 40; ++seed) {
      const Thrown thrown = make_thrown({.seed = seed,
                                         .throws = 5,
                                         .state_sigma = stated,
                                         .max_offset_s = 0.015,
                                         .drag_per_m = 0.0175,
                                         .estimate_drag = true});
      nees += nees_per_freedom(thrown, refine_from_rough(thrown, seed), freedom);
    }
    EXPECT_NEAR(nees / freedom, 1.0, 4 * std::sqrt(2 / freedom)) << "sigma stated: " << stated;
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
  EXPECT_LT(nees_per_freedom(thrown, at, freedom) / freedom, 2.0);
}

TEST(Refinement, ChiSquareIsNearItsDegreesOfFreedom) {
  const Refinement at = refine_from_rough(make_thrown({.seed = 5}), 5);
  EXPECT_NEAR(at.chi2, at.degrees_of_freedom, 5 * std::sqrt(2.0 * at.degrees_of_freedom));
}

TEST(Refinement, ARollingShutterCostsNothing) {
  const Thrown thrown = make_thrown({.row_time_s = 20e-6});
  double freedom = 0;
  const double nees = nees_per_freedom(thrown, refine_from_rough(thrown, 1), freedom);
  EXPECT_LT(nees / freedom, 1 + 4 * std::sqrt(2 / freedom));
}

TEST(Refinement, DropsFromOneSpotLeaveADirectionUndetermined) {
  const Thrown thrown = make_thrown({.throws = 1, .vertical_drops = true});
  const auto timed = time_throws(thrown.rig, thrown.throws);
  const Refinement at = refine(thrown.rig, timed, test::true_solution(thrown, timed));
  const auto wide = [&](std::size_t k) {
    return at.covariance.block<3, 3>(7 * k + 3, 7 * k + 3).trace() > 0.01;
  };
  EXPECT_TRUE(!at.undetermined.empty() || wide(1));
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
  const NormalEquations normal = normal_equations(thrown.rig, timed, at, weighting, 0.0);
  // The reduced gradient is that of the cost minimised over the balls; to first order it is the
  // plain gradient minus the balls' share, so compare along steps in which the balls follow.
  for (int i : {3, 7, 9, 11, 13, 28}) {
    const auto moved = [&](double h) {
      Solution s = at;
      Eigen::VectorXd step = Eigen::VectorXd::Zero(slice::rig_size(4));
      step[i] = h;
      if (i < 6) step.segment<3>(3) = h * camera_one_turns(at.rig.T_world_cam[0]).col(0);
      s.rig.apply(step);
      for (std::size_t j = 0; j < s.balls.size(); ++j) {
        const Eigen::Matrix<double, 6, 1> move =
            -(normal.balls[j].inverse_information * normal.balls[j].coupling.transpose() * step);
        s.balls[j].position_m += move.head<3>(), s.balls[j].velocity_mps += move.tail<3>();
      }
      return cost(thrown.rig, timed, s, weighting);
    };
    constexpr double h = 1e-6;
    Eigen::VectorXd direction = Eigen::VectorXd::Zero(slice::rig_size(4));
    direction[i] = 1;
    if (i < 6) direction.segment<3>(3) = camera_one_turns(at.rig.T_world_cam[0]).col(0);
    const double numeric = (moved(h) - moved(-h)) / (2 * h),
                 analytic = -2 * normal.gradient.dot(direction);
    EXPECT_NEAR(numeric, analytic, 2e-3 * std::max(1e3, std::abs(analytic))) << i;
  }
}

}  // namespace
}  // namespace throwcal
