// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/ekf.h"

#include "tests/support/allocation_count.h"
#include "tests/support/jacobian_check.h"
#include "tests/support/true_solution.h"

namespace throwcal {
namespace {

using test::make_thrown;
using test::Thrown;

/// A rig of every kind: synchronised, free-running with drag, with lens numbers to be estimated.
class EveryRig : public testing::TestWithParam<const char*> {
 protected:
  EveryRig() {
    const std::string kind = GetParam();
    test::ThrowerSettings settings{.throws = 2};
    if (kind != "synchronised")
      settings.max_offset_s = 0.01, settings.drag_per_m = 0.0175, settings.estimate_drag = true;
    if (kind == "rolling_lens") settings.row_time_s = 15e-6;
    thrown_ = make_thrown(settings);
    if (kind == "rolling_lens")
      for (CameraDescription& camera : thrown_.rig.cameras)
        camera.estimate = {Intrinsic::fx, Intrinsic::d0, Intrinsic::row_time};
    timed_ = time_throws(thrown_.rig, thrown_.throws);
    truth_ = test::true_solution(thrown_, timed_);
  }
  Thrown thrown_;
  std::vector<TimedThrow> timed_;
  Solution truth_;
};
INSTANTIATE_TEST_SUITE_P(, EveryRig,
                         testing::Values("synchronised", "free_running", "rolling_lens"),
                         [](const auto& of) { return std::string(of.param); });

TEST_P(EveryRig, AStepOfTheFilterAllocatesNothing) {
#ifndef COUNTS_ALLOCATIONS
  GTEST_SKIP() << "needs glibc's malloc, without a sanitizer's";
#else
  Ekf filter(thrown_.rig, truth_.rig, {});
  filter.start_throw(truth_.balls[0]);
  const long before = allocations;
  for (const TimedSighting& s : timed_[0].sightings) filter.update(s);
  filter.predict(0.0);
  filter.reset_rig_covariance();
  filter.start_throw(truth_.balls[1]);
  EXPECT_EQ(allocations, before);
  EXPECT_GT(before, 0) << "the count itself must work";
#endif
}

TEST_P(EveryRig, TheCovarianceStaysSymmetricAndPositiveThroughAThrowAndBack) {
  Ekf filter(thrown_.rig, truth_.rig, {});
  filter.start_throw(truth_.balls[0]);
  for (const TimedSighting& s : timed_[0].sightings) filter.update(s);
  for (auto s = timed_[0].sightings.rbegin(); s != timed_[0].sightings.rend(); ++s)
    filter.update(*s);
  const Eigen::MatrixXd P = filter.covariance();
  EXPECT_LT((P - P.transpose()).cwiseAbs().maxCoeff(), 1e-15 * P.cwiseAbs().maxCoeff());
  const Eigen::VectorXd scale = P.diagonal().cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd correlations = scale.asDiagonal() * P * scale.asDiagonal();
  EXPECT_GT(Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(correlations).eigenvalues()[0], 0.0);
}

TEST_P(EveryRig, OneUpdateIsBayesRuleOnTheLinearisedSighting) {
  // Against the information form: P'^-1 = P^-1 + H^T R^-1 H, with H from central differences of
  // the sighting's prediction by the whole super-state. Process noise off: the flight is exact.
  EkfSettings settings;
  settings.process_acceleration_mps2 = 0.0, settings.huber_sigmas = 1e9;
  settings.noise_rad = 3.0 / 900;
  Ekf filter(thrown_.rig, truth_.rig, settings);
  filter.start_throw(truth_.balls[0]);
  const TimedSighting& first = timed_[0].sightings[20];
  filter.update(first);  // P is full from here on
  const Eigen::MatrixXd before = filter.covariance();
  const RigState rig = filter.rig();
  const BallState ball = filter.ball();
  const RigLayout layout(thrown_.rig, rig);
  // The same camera's same sighting again: no flight in between.
  const auto predicted = [&](const Eigen::VectorXd& d) {
    RigState moved = rig;
    layout.apply(d.tail(layout.size()), moved);
    // A later moment, by this camera's clock or rows, finds the ball farther on.
    const double later_s = moment_s(moved, first) - moment_s(rig, first);
    const BallState at{ball.position_m + d.head<3>() + later_s * ball.velocity_mps,
                       ball.velocity_mps};
    const CameraModel& model = moved.models[first.camera];
    return Eigen::VectorXd(
        *model.project(moved.T_world_cam[first.camera].inverse() * at.position_m));
  };
  Eigen::MatrixXd H(2, before.rows());
  for (Eigen::Index i = 0; i < H.cols(); ++i) {
    Eigen::VectorXd d = Eigen::VectorXd::Zero(H.cols());
    d[i] = 1e-6;
    H.col(i) = (predicted(d) - predicted(-d)) / 2e-6;
  }
  Eigen::Matrix2d coupling = Eigen::Matrix2d::Identity();
  SightingModel plain;
  RigState global = rig;
  global.models[first.camera].row_time_s = 0.0;
  ASSERT_TRUE(model_sighting(global, ball, first, false, false, plain));
  coupling.col(1) -= rig.models[first.camera].row_time_s * plain.J_offset;
  H = coupling.inverse() * H;
  filter.update(first);
  const Eigen::MatrixXd S = H * before * H.transpose() + 9.0 * Eigen::MatrixXd::Identity(2, 2);
  const Eigen::MatrixXd expected = before - before * H.transpose() * S.inverse() * H * before;
  const Eigen::VectorXd scale = before.diagonal().cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd off =
      scale.asDiagonal() * (filter.covariance() - expected) * scale.asDiagonal();
  // The offset just moved a little, so the second update flies for that while.
  EXPECT_LT(off.cwiseAbs().maxCoeff(), 2e-3);
}

TEST_P(EveryRig, PredictingForwardAndBackIsNothing) {
  EkfSettings settings;
  settings.process_acceleration_mps2 = 0.0;
  Ekf filter(thrown_.rig, truth_.rig, settings);
  filter.start_throw(truth_.balls[0]);
  for (std::size_t i = 0; i < 8; ++i) filter.update(timed_[0].sightings[i]);
  filter.predict(0.0);
  const Eigen::MatrixXd before = filter.covariance();
  const BallState ball = filter.ball();
  filter.predict(0.4), filter.predict(0.0);
  EXPECT_LT((filter.ball().position_m - ball.position_m).norm(), 1e-7);
  EXPECT_LT((filter.covariance() - before).cwiseAbs().maxCoeff(),
            1e-7 * before.cwiseAbs().maxCoeff());
}

TEST(Ekf, PseudoNoiseKeepsTheRigsGainsAlive) {
  const Thrown thrown = make_thrown({.throws = 1});
  const auto timed = time_throws(thrown.rig, thrown.throws);
  const Solution truth = test::true_solution(thrown, timed);
  EkfSettings settings;
  settings.pseudo_noise_variance = 1e-4;
  Ekf filter(thrown.rig, truth.rig, settings);
  filter.start_throw(truth.balls[0]);
  const double before = filter.covariance().diagonal().tail(20).minCoeff();
  filter.predict(-0.4), filter.predict(0.6);
  EXPECT_NEAR(filter.covariance().diagonal().tail(20).minCoeff(), before + 1.4e-4, 1e-12);
}

}  // namespace
}  // namespace throwcal
