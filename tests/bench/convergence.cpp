// SPDX-License-Identifier: BSD-3-Clause
// How RB-EKF alone converges from rough starts: CSV for plot_convergence.py, and a summary on
// standard error. Usage: convergence [STARTS] > convergence.csv
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <numbers>

#include "estimator/refinement.h"
#include "estimator/throw_iteration.h"
#include "tests/bench/cases.h"
#include "tests/support/thesis_rig.h"
#include "tests/support/true_solution.h"

namespace throwcal {
namespace {

constexpr int max_sweeps = 15;
constexpr double still_converged = 3.0;  // times the joint refinement's rms error

struct Recording {
  RigDescription rig;
  std::vector<TimedThrow> throws;
  Solution truth;
};

Recording of_thrown(const test::Thrown& thrown) {
  const auto timed = time_throws(thrown.rig, thrown.throws);
  return {thrown.rig, timed, test::true_solution(thrown, timed)};
}

/// The rig of the thesis' 6.4 and 6.5 and its first throws, with 0.1 px of noise.
Recording of_thesis(std::uint64_t seed, std::size_t throws) {
  constexpr double quarter = 0.5 * std::numbers::pi;
  test::ThesisExperiment experiment{.name = "6.5", .sigma_px = 0.1};
  experiment.truth << -0.2, -0.2, -quarter, quarter, quarter, 1.5, 0.2, 1.5;
  experiment.guess = experiment.truth;
  const test::ThesisBall first{{0.5, 0, 1}, {-1.2, 4, 1.2}},
      second{{-0.5, 0.25, 1.3}, {1.2, 3.5, 1.2}};
  experiment.throws = {{first, first}, {second, second}};
  experiment.throws.resize(throws);
  const test::ThesisRecording recording = test::record(experiment, seed);
  const auto timed = time_throws(recording.rig, recording.throws);
  return {recording.rig, timed, test::guessed_solution(experiment, recording.rig, timed)};
}

struct Scene {
  const char* name;
  Recording (*record)(std::uint64_t seed);
};

/// Rotation and position error of a rig, rms over its cameras [rad], [m].
Eigen::Vector2d error_of(const RigState& truth, const RigState& rig) {
  Eigen::Vector2d squares = Eigen::Vector2d::Zero();
  for (std::size_t k = 0; k < rig.cameras(); ++k) {
    const Rigid &a = truth.T_world_cam[k], &b = rig.T_world_cam[k];
    squares += Eigen::Vector2d(log_so3(a.rotation * b.rotation.transpose()).squaredNorm(),
                               (a.translation - b.translation).squaredNorm());
  }
  return (squares / static_cast<double>(rig.cameras())).cwiseSqrt();
}

double quantile(std::vector<double> values, double q) {
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(q * static_cast<double>(values.size() - 1) + 0.5)];
}

/// Root mean square of each of the two errors, over all starts or those that converged.
Eigen::Vector2d rms(const std::vector<Eigen::Vector2d>& errors, const std::vector<char>& which) {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  double count = 0.0;
  for (std::size_t i = 0; i < errors.size(); ++i)
    if (which[i]) sum += errors[i].cwiseAbs2(), count += 1;
  return (sum / std::max(count, 1.0)).cwiseSqrt();
}

void run(const Scene& scene, int starts) {
  std::vector<std::vector<Eigen::Vector2d>> errors(max_sweeps + 1);  // [sweep][start]
  std::vector<Eigen::Vector2d> refined;
  for (int seed = 1; seed <= starts; ++seed) {
    const Recording of = scene.record(static_cast<std::uint64_t>(seed));
    const Solution start =
        test::rough_start(of.truth, 0.3, 0.5, 1.0, static_cast<std::uint64_t>(seed));
    refined.push_back(error_of(of.truth.rig, refine(of.rig, of.throws, of.truth).solution.rig));
    for (int sweeps = 0; sweeps <= max_sweeps; ++sweeps)
      errors[sweeps].push_back(error_of(
          of.truth.rig,
          iterate_throws(of.rig, of.throws, start, Method::rb_ekf, {.ekf = {}, .sweeps = sweeps})
              .rig));
  }
  const Eigen::Vector2d bound = rms(refined, std::vector<char>(refined.size(), 1));
  for (int sweeps = 0; sweeps <= max_sweeps; ++sweeps) {
    std::vector<double> worse;
    std::vector<char> converged;
    for (const Eigen::Vector2d& error : errors[sweeps]) {
      worse.push_back(error.cwiseQuotient(bound).maxCoeff());
      converged.push_back(worse.back() < still_converged);
    }
    const auto count = std::count(converged.begin(), converged.end(), 1);
    const Eigen::Vector2d ratio =
        rms(errors[sweeps], converged).cwiseQuotient(rms(refined, converged));
    std::printf("\"%s\",%d,%.4g,%.4g,%.4g,%.4f,%.4f,%.4f\n", scene.name, sweeps,
                quantile(worse, 0.5), quantile(worse, 0.1), quantile(worse, 0.9),
                static_cast<double>(count) / starts, ratio[0], ratio[1]);
    if (sweeps == 5 || sweeps == 10 || sweeps == 15)
      std::fprintf(stderr,
                   "%-36s %2d sweeps: %ld of %d converged, ratio %.3f (rotation) %.3f (position)\n",
                   scene.name, sweeps, static_cast<long>(count), starts, ratio[0], ratio[1]);
  }
}

}  // namespace
}  // namespace throwcal

int main(int count, char** arguments) {
  const int starts = count > 1 ? std::atoi(arguments[1]) : 200;
  std::puts("scene,sweep,median,p10,p90,converged,ratio_rotation,ratio_position");
  using namespace throwcal;
  run({"thesis 6.4, 1 throw", [](auto seed) { return of_thesis(seed, 1); }}, starts);
  run({"thesis 6.5, 2 throws", [](auto seed) { return of_thesis(seed, 2); }}, starts);
  run({"2 cameras 4 m away, 2 throws",
       [](auto seed) { return of_thrown(bench::thesis_rig(seed, 2, 0.1)); }},
      starts);
  run({"4 cameras, 5 throws",
       [](auto seed) { return of_thrown(test::make_thrown({.seed = seed})); }},
      starts);
}
