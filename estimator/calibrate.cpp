// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/calibrate.h"

#include <algorithm>

#include "estimator/bootstrap.h"
#include "estimator/refinement.h"
#include "estimator/report.h"
#include "estimator/throw_iteration.h"
#include "estimator/verdict.h"

namespace throwcal {
namespace {

constexpr int rescue_sweeps = 10;  // of RB-EKF where a start is far off

/// The throws whose ball has a start, and the solution that begins there.
struct Candidate {
  std::vector<TimedThrow> throws;
  Solution solution;
};

Candidate candidate_of(const Start& start, const std::vector<TimedThrow>& throws) {
  Candidate out{{}, {start.rig, {}}};
  for (std::size_t j = 0; j < throws.size(); ++j)
    if (start.balls[j])
      out.throws.push_back(throws[j]), out.solution.balls.push_back(*start.balls[j]);
  return out;
}

/// Where to begin: the closed form, a guess, or (full method) both, for a bad guess must not hurt.
std::vector<Candidate> candidates(const RigDescription& rig, const std::vector<Throw>& throws,
                                  const CalibrateSettings& settings) {
  const std::vector<TimedThrow> timed = time_throws(rig, throws);
  FitMemory own;
  FitMemory& fits = settings.fits ? *settings.fits : own;
  const FlightTable flights = fit_all_flights(rig, throws, fits);
  fits.forget_unused();
  std::vector<Candidate> out;
  if (settings.guess)
    out.push_back(candidate_of(start_from_guess(rig, timed, flights, *settings.guess), timed));
  if (!settings.guess || settings.method == Method::full)
    if (const auto start = bootstrap(rig, timed, flights))
      out.push_back(candidate_of(*start, timed));
  std::erase_if(out, [](const Candidate& c) { return c.throws.empty(); });
  return out;
}

/// Whether a start explains half of the sightings to within a tenth of the noise that the filter
/// believes in: then the filter has nothing to say that the refinement does not say better.
bool is_near(const RigDescription& rig, const Candidate& candidate) {
  std::vector<double> sizes_rad;
  const auto residuals = claimed_residuals(rig, candidate.throws, candidate.solution);
  for (std::size_t j = 0; j < residuals.size(); ++j)
    for (std::size_t i = 0; i < residuals[j].size(); ++i) {
      const TimedSighting& s = candidate.throws[j].sightings[i];
      if (candidate.solution.rig.is_placed[s.camera])
        sizes_rad.push_back((s.whitening.inverse() * residuals[j][i]).norm() /
                            rig.cameras[s.camera].model.fx_px);
    }
  const auto far = [](double rad) { return !(rad < 0.1 * EkfSettings{}.noise_rad); };  // NaN too
  return 2 * std::count_if(sizes_rad.begin(), sizes_rad.end(), far) <
         static_cast<std::ptrdiff_t>(sizes_rad.size());
}

/// The filters' part: all of it where one is asked for by name, a rescue in the full method.
Solution filtered(const RigDescription& rig, const Candidate& candidate,
                  const CalibrateSettings& settings) {
  if (settings.method != Method::full)
    return iterate_throws(rig, candidate.throws, candidate.solution, settings.method,
                          {.ekf = {},
                           .sweeps = settings.throw_iterations,
                           .enough = 1e-5,
                           .progress = settings.progress});
  if (is_near(rig, candidate)) return candidate.solution;
  return iterate_throws(
      rig, candidate.throws, candidate.solution, Method::rb_ekf,
      {.ekf = {}, .sweeps = rescue_sweeps, .enough = 1e-3, .progress = settings.progress});
}

/// Of two refinements: the one that explains more sightings, then the one that explains them
/// better.
bool is_better(const Refinement& a, const Refinement& b) {
  if (a.degrees_of_freedom != b.degrees_of_freedom)
    return a.degrees_of_freedom > b.degrees_of_freedom;
  return a.chi2 < b.chi2;
}

}  // namespace

Calibration calibrate(const RigDescription& rig, const std::vector<Throw>& throws,
                      const CalibrateSettings& settings) {
  std::vector<Throw> seen = throws;
  std::erase_if(seen, [](const Throw& t) {
    return std::all_of(t.tracks.begin(), t.tracks.end(),
                       [](const Track& k) { return k.sightings.empty(); });
  });

  std::optional<Refinement> best;
  Candidate best_candidate;
  for (Candidate& candidate : candidates(rig, seen, settings)) {
    RefinementSettings refinement;
    if (settings.method != Method::full) refinement.max_iterations = 0;
    Refinement refined =
        refine(rig, candidate.throws, filtered(rig, candidate, settings), refinement);
    if (!best || is_better(refined, *best)) best = std::move(refined), best_candidate = candidate;
  }
  if (!best) return report_nothing_to_go_by(rig, seen, settings.method);
  return report(rig, seen, best_candidate.throws, *best, settings.method);
}

}  // namespace throwcal
