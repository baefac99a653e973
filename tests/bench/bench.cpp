// SPDX-License-Identifier: BSD-3-Clause
// The joint refinement beside Ceres on the same problem, the whole method, and the filter: times.
// Nothing is timed before both have been seen to reach the same poses and the same covariance.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "estimator/calibrate.h"
#include "estimator/refinement.h"
#include "estimator/throw_iteration.h"
#include "tests/bench/cases.h"
#include "tests/bench/ceres_rival.h"
#include "tests/support/true_solution.h"

namespace throwcal::bench {
namespace {

void demand(bool holds, const std::string& what, double found) {
  std::fprintf(stderr, "%s: %.2e%s\n", what.c_str(), found, holds ? "" : " DIFFERS");
  if (!holds) std::abort();
}

/// Both end at the same cost (1e-9 relative), poses (1e-6 m, 1e-6 rad) and covariance (1 % of the
/// product of the two sigmas).
void demand_agreement(const Case& of) {
  const Refinement ours = refine(of.thrown.rig, of.throws, of.start);
  const bool all_used = std::all_of(
      ours.weighting.used.begin(), ours.weighting.used.end(), [](const std::vector<char>& thrown) {
        return std::all_of(thrown.begin(), thrown.end(), [](char used) { return used; });
      });
  demand(all_used, of.name + ": sightings, none gated", 1);
  CeresRival rival(of.thrown.rig, of.throws, of.start);
  rival.solve();
  const Solution theirs = rival.solution();
  double apart_m = 0.0, apart_rad = 0.0;
  for (std::size_t k = 0; k < theirs.rig.cameras(); ++k) {
    const Rigid &a = ours.solution.rig.T_world_cam[k], &b = theirs.rig.T_world_cam[k];
    apart_m = std::max(apart_m, (a.translation - b.translation).norm());
    apart_rad = std::max(apart_rad, log_so3(a.rotation * b.rotation.transpose()).norm());
  }
  const double cost_gap = std::abs(rival.cost() / ours.chi2 - 1);
  demand(cost_gap < 1e-9, of.name + ": costs apart by", cost_gap);
  demand(apart_m < 1e-6, of.name + ": positions apart by, m", apart_m);
  demand(apart_rad < 1e-6, of.name + ": rotations apart by, rad", apart_rad);
  const Eigen::MatrixXd covariance = rival.covariance();
  demand(covariance.rows() == ours.covariance.rows(), of.name + ": Ceres' covariance's size",
         static_cast<double>(covariance.rows()));
  const Eigen::VectorXd sigma = ours.covariance.diagonal().cwiseSqrt();
  const double covariance_gap = (sigma.cwiseInverse().asDiagonal() *
                                 (covariance - ours.covariance) * sigma.cwiseInverse().asDiagonal())
                                    .cwiseAbs()
                                    .maxCoeff();
  demand(covariance_gap < 0.01, of.name + ": covariances apart by, of sigmas", covariance_gap);
}

void add_contenders(const Case& of) {
  const auto add = [&](const char* name, auto work) {
    benchmark::RegisterBenchmark((of.name + "/" + name).c_str(), work)
        ->MeasureProcessCPUTime()
        ->Unit(benchmark::kMillisecond);
  };
  const RigDescription& rig = of.thrown.rig;
  add("refine", [&](benchmark::State& state) {
    for (auto _ : state) benchmark::DoNotOptimize(refine(rig, of.throws, of.start));
  });
  add("calibrate", [&](benchmark::State& state) {
    for (auto _ : state) benchmark::DoNotOptimize(calibrate(rig, of.thrown.throws));
  });
  add("ceres", [&](benchmark::State& state) {
    CeresRival rival(rig, of.throws, of.start);
    for (auto _ : state) {
      rival.set_start(of.start);
      rival.solve();
      benchmark::DoNotOptimize(rival.covariance());
    }
  });
  add("ceres_build", [&](benchmark::State& state) {
    for (auto _ : state) benchmark::DoNotOptimize(CeresRival(rig, of.throws, of.start));
  });
  add("ceres_solve", [&](benchmark::State& state) {
    CeresRival rival(rig, of.throws, of.start);
    for (auto _ : state) {
      rival.set_start(of.start);
      rival.solve();
    }
  });
  add("ceres_covariance", [&](benchmark::State& state) {
    CeresRival rival(rig, of.throws, of.start);
    rival.solve();
    for (auto _ : state) benchmark::DoNotOptimize(rival.covariance());
  });
}

/// Why CeresChoice's defaults are what they are: solve and covariance with each of the others.
void add_choices(const Case& of) {
  const auto add = [&](const char* name, auto change) {
    CeresChoice choice;
    change(choice);
    benchmark::RegisterBenchmark(("choice/" + of.name + "/" + name).c_str(),
                                 [&of, choice](benchmark::State& state) {
                                   CeresRival rival(of.thrown.rig, of.throws, of.start, choice);
                                   for (auto _ : state) {
                                     rival.set_start(of.start);
                                     rival.solve();
                                     benchmark::DoNotOptimize(rival.covariance());
                                   }
                                 })
        ->MeasureProcessCPUTime()
        ->Unit(benchmark::kMillisecond);
  };
  add("chosen", [](CeresChoice&) {});
  add("two_threads", [](CeresChoice& c) { c.threads = 2; });
  add("dense_Schur_LAPACK", [](CeresChoice& c) { c.dense = ceres::LAPACK; });
  add("sparse_Schur_SuiteSparse", [](CeresChoice& c) { c.solver = ceres::SPARSE_SCHUR; });
  add("sparse_Schur_Eigen",
      [](CeresChoice& c) { c.solver = ceres::SPARSE_SCHUR, c.sparse = ceres::EIGEN_SPARSE; });
  add("sparse_Cholesky", [](CeresChoice& c) { c.solver = ceres::SPARSE_NORMAL_CHOLESKY; });
  add("dense_Cholesky", [](CeresChoice& c) { c.solver = ceres::DENSE_NORMAL_CHOLESKY; });
  add("first_radius_1e4", [](CeresChoice& c) { c.first_radius = 1e4; });
  add("covariance_Eigen_sparse_QR",
      [](CeresChoice& c) { c.covariance_sparse = ceres::EIGEN_SPARSE; });
  add("covariance_dense_SVD", [](CeresChoice& c) { c.covariance = ceres::DENSE_SVD; });
}

/// 1000 RB-EKF throw iterations of 2 cameras x 30 frames: 120 000 predictions and updates.
void throw_iterations(benchmark::State& state) {
  const test::Thrown thrown = thesis_rig(1, 1, 0.1);
  const auto timed = time_throws(thrown.rig, thrown.throws);
  const Solution start = test::rough_start(test::true_solution(thrown, timed), 0.3, 0.5, 1.0, 1);
  for (auto _ : state)
    benchmark::DoNotOptimize(iterate_throws(thrown.rig, timed, start, Method::rb_ekf,
                                            {.ekf = {}, .sweeps = 1000, .enough = 0.0}));
  state.counters["sightings"] = static_cast<double>(timed[0].sightings.size());
}

}  // namespace
}  // namespace throwcal::bench

int main(int argc, char** argv) {
  using namespace throwcal::bench;
  const std::vector<Case> cases{four_cameras(false), four_cameras(true)};
  for (const Case& of : cases) demand_agreement(of);
  for (const Case& of : cases) add_contenders(of), add_choices(of);
  benchmark::RegisterBenchmark("1000_throw_iterations", throw_iterations)
      ->Unit(benchmark::kMillisecond);
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 2;
  benchmark::RunSpecifiedBenchmarks();
}
