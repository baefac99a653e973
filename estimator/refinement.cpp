// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/refinement.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "estimator/elementary.h"

namespace throwcal {
namespace {

constexpr double undetermined_eigenvalue =
    1e-12;  // of the scaled information: below it is rounding
// Squared distance to the optimum, in sigmas, that a descent may leave: while outliers are looked
// for a third of a sigma a parameter will do, at the end it is a thousandth in all.
constexpr double near_enough_each = 0.1, at_optimum = 1e-6, nearly = 1e-4;
constexpr int least_of_throw = 4;  // sightings that fix a ball
constexpr double least_damping = 1e-9, first_damping = 1e-4, max_damping = 1e8;

struct Problem {
  const RigDescription& rig;
  const std::vector<TimedThrow>& throws;
  const RefinementSettings& settings;
};

/// A step of everything, and what the linear model says that it is worth.
struct Step {
  Solution to;
  double decrement = 0.0;  ///< squared length in sigmas
};

Step damped_step(const Refinement& from, const NormalEquations& normal, double damping) {
  const ReducedEquations reduced = eliminate_balls(normal, damping);
  const Eigen::VectorXd scale =
      reduced.information.diagonal().cwiseMax(1e-12).cwiseSqrt().cwiseInverse();
  const Eigen::VectorXd rig_step =
      scale.asDiagonal() * (scale.asDiagonal() * reduced.information * scale.asDiagonal())
                               .eval()
                               .ldlt()
                               .solve(scale.asDiagonal() * reduced.gradient);
  Step out{from.solution, rig_step.dot(normal.gradient)};
  from.layout.apply(rig_step, out.to.rig);
  for (std::size_t j = 0; j < out.to.balls.size(); ++j) {
    const NormalEquations::Vector6 move = reduced.ball_step(normal, j, rig_step);
    out.to.balls[j].position_m += move.head<3>();
    out.to.balls[j].velocity_mps += move.tail<3>();
    out.decrement += move.dot(normal.balls[j].gradient);
  }
  return out;
}

/// The linearisation, and whether it is the one at the solution. One is enough: where a step is not
/// taken its equations serve again. (Memory that is touched anew costs as much as filling it.)
struct Linearised {
  Linearisation rows;
  bool at_solution = false;
};

void linearise_at_solution(const Problem& p, const Refinement& at, Linearised& linear) {
  if (!linear.at_solution) linearise(p.rig, p.throws, at.solution, linear.rows);
  linear.at_solution = true;
}

/// Levenberg-Marquardt with weights that follow the residuals: `reweigh` changes them before each
/// step and says whether the change matters; `is_done` may end it after any step. Ends where a step
/// would be shorter than `enough`, without taking it, and returns the equations there; nothing
/// where it does not get so far.
template <typename Reweigh, typename IsDone>
std::optional<NormalEquations> descend(const Problem& p, Refinement& at, Linearised& linear,
                                       double enough, Reweigh reweigh, IsDone is_done) {
  double damping = least_damping;
  for (int i = 0; i < p.settings.max_iterations; ++i) {
    ++at.iterations;
    const bool reweighed = reweigh();
    linearise_at_solution(p, at, linear);
    NormalEquations normal =
        normal_equations(p.throws, linear.rows, at.solution.rig, at.layout, at.weighting);
    const double current = cost(p.throws, at.residuals, at.weighting);
    while (true) {
      Step step = damped_step(at, normal, damping);
      if (!reweighed && damping <= first_damping && std::abs(step.decrement) <= enough)
        return normal;
      // Steps converge quadratically: the last needs no new equations.
      const bool is_last = enough == at_optimum && !reweighed && damping <= first_damping &&
                           std::abs(step.decrement) <= nearly;
      PerSighting<Eigen::Vector2d> residuals;
      linear.at_solution = false;
      if (is_last)
        residuals = claimed_residuals(p.rig, p.throws, step.to);
      else
        linearise(p.rig, p.throws, step.to, linear.rows), residuals = linear.rows.residuals();
      if (cost(p.throws, residuals, at.weighting) <= current) {  // false for NaN too
        at.solution = std::move(step.to), at.residuals = std::move(residuals);
        if (is_last) return normal;
        linear.at_solution = true;
        if (is_done()) return {};
        damping = std::max(0.1 * damping, least_damping);
        break;
      }
      // At the optimum rounding alone decides whether the cost falls.
      const bool arrived = std::abs(step.decrement) <= std::max(enough, 1e-12 * current);
      if (arrived && !reweighed) return normal;
      if (damping > max_damping) return {};
      if (arrived) break;
      damping = std::max(10 * damping, first_damping);
    }
  }
  return {};
}

double median(std::vector<double> values) {
  if (values.empty()) return 0.0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Calls visit(throw, sighting index, camera).
template <typename Visit>
void for_each(const std::vector<TimedThrow>& throws, Visit visit) {
  for (std::size_t j = 0; j < throws.size(); ++j)
    for (std::size_t i = 0; i < throws[j].sightings.size(); ++i)
      visit(j, i, throws[j].sightings[i].camera);
}

PerSighting<char> all_placed(const Problem& p, const RigState& rig) {
  PerSighting<char> out;
  for (const TimedThrow& thrown : p.throws) {
    out.emplace_back();
    for (const TimedSighting& s : thrown.sightings) out.back().push_back(rig.is_placed[s.camera]);
  }
  return out;
}

/// Robust noise scales: 1.4826 x each camera's median absolute residual, outliers and all; a stated
/// sigma is only ever widened. They follow the residuals down: from a rough start nearly everything
/// is "far", and a fixed threshold would turn the problem into the slow L1 one. Returns whether any
/// changed by more than a fifth.
bool follow_medians(const Problem& p, Refinement& at) {
  std::vector<std::vector<double>> sizes(p.rig.cameras.size());
  for_each(p.throws, [&](std::size_t j, std::size_t i, CameraId k) {
    const Eigen::Vector2d& r = at.residuals[j][i];
    if (at.weighting.used[j][i] && r.allFinite())
      sizes[k].insert(sizes[k].end(), {std::abs(r[0]), std::abs(r[1])});
  });
  double change = 0.0;
  for (std::size_t k = 0; k < sizes.size(); ++k) {
    const double least = p.rig.cameras[k].sigma_px ? 1.0 : 1e-6;
    const double scale = std::max(1.4826 * median(std::move(sizes[k])), least);
    change = std::max(change, std::abs(elementary::log(scale / at.weighting.noise_scale[k])));
    at.weighting.noise_scale[k] = scale;
  }
  return change > 0.2;
}

int free_parameters(const Refinement& at) {
  int balls = 0;
  for (const auto& used : at.weighting.used)
    balls += std::any_of(used.begin(), used.end(), [](char u) { return u; });
  return at.layout.size() + RigLayout::ball_size * balls;
}

bool all_stated(const RigDescription& rig) {
  return std::all_of(rig.cameras.begin(), rig.cameras.end(),
                     [](const auto& c) { return c.sigma_px.has_value(); });
}

/// Whether all that is placed is used and within the gate, as nearly always: then it need not be
/// chosen anew.
bool is_all_within_gate(const Problem& p, const Refinement& at) {
  std::vector<double> limits;
  for (double scale : at.weighting.noise_scale)
    limits.push_back(p.settings.gate_chi2 * scale * scale);
  for (std::size_t j = 0; j < p.throws.size(); ++j) {
    int count = 0;
    for (std::size_t i = 0; i < p.throws[j].sightings.size(); ++i) {
      const CameraId k = p.throws[j].sightings[i].camera;
      const bool used = at.weighting.used[j][i];
      if (used != at.solution.rig.is_placed[k]) return false;
      if (used && !(at.residuals[j][i].squaredNorm() <= limits[k])) return false;  // NaN too
      count += used;
    }
    if (count < least_of_throw) return false;
  }
  return true;
}

/// Takes out what lies beyond the gate, and throws that are left with too little to fix their ball.
/// Returns whether the choice changed.
bool gate(const Problem& p, Refinement& at) {
  if (is_all_within_gate(p, at)) return false;
  PerSighting<char> used = all_placed(p, at.solution.rig);
  double gated = 0.0, total = 0.0;
  for_each(p.throws, [&](std::size_t j, std::size_t i, CameraId k) {
    if (!used[j][i]) return;
    const double limit = p.settings.gate_chi2 * square(at.weighting.noise_scale[k]);
    used[j][i] = at.residuals[j][i].squaredNorm() <= limit;  // false for NaN
    gated += !used[j][i], total += 1;
  });
  const bool stated = std::any_of(p.rig.cameras.begin(), p.rig.cameras.end(),
                                  [](const auto& c) { return c.sigma_px.has_value(); });
  if (stated && gated > p.settings.max_gated * total) used = all_placed(p, at.solution.rig);
  for (auto& thrown : used)
    if (std::count(thrown.begin(), thrown.end(), 1) < least_of_throw)
      std::fill(thrown.begin(), thrown.end(), 0);
  const bool changed = used != at.weighting.used;
  at.weighting.used = std::move(used);
  return changed;
}

/// Each camera's noise from its residuals' mean square, corrected for what the fit took; the claim
/// stands where stated. Returns whether any changed by more than a ten-thousandth.
bool measure_noise(const Problem& p, Refinement& at) {
  if (all_stated(p.rig)) return false;
  std::vector<double> sum(p.rig.cameras.size(), 0.0), count(sum);
  double total = 0.0;
  for_each(p.throws, [&](std::size_t j, std::size_t i, CameraId k) {
    if (!at.weighting.used[j][i] || !at.residuals[j][i].allFinite()) return;
    sum[k] += at.residuals[j][i].squaredNorm(), count[k] += 2, total += 2;
  });
  const double kept = 1.0 - free_parameters(at) / total;
  double change = 0.0;
  for (std::size_t k = 0; k < sum.size(); ++k) {
    double scale = at.weighting.noise_scale[k];
    if (p.rig.cameras[k].sigma_px)
      scale = 1.0;
    else if (count[k] > 0 && kept > 0)
      scale = std::max(std::sqrt(sum[k] / (count[k] * kept)), 1e-6);
    change = std::max(change, std::abs(scale / at.weighting.noise_scale[k] - 1));
    at.weighting.noise_scale[k] = scale;
  }
  return change > 1e-4;
}

/// What the errors that a camera's sightings share add to the covariance: the solution's answer to
/// all of them shifted by one sigma along each axis ("consider" covariance). Averaging over a
/// thousand sightings does not lower it, so leaving it out would promise tenths of a millimetre
/// that a lit side of the ball takes back.
Eigen::MatrixXd common_error_covariance(const Problem& p, const Linearisation& linear,
                                        const NormalEquations& normal,
                                        const ReducedEquations& reduced, const Refinement& at) {
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(at.covariance.rows(), at.covariance.cols());
  for (CameraId k = 0; k < p.rig.cameras.size(); ++k)
    for (int axis = 0; axis < 2; ++axis) {
      const double sigma_px = p.rig.cameras[k].sigma_common_px;
      if (!(sigma_px > 0) || !at.solution.rig.is_placed[k]) continue;
      const Eigen::VectorXd answer =
          at.covariance * gradient_of_shift(p.throws, linear, at.solution.rig, at.layout,
                                            at.weighting, normal, reduced, k,
                                            sigma_px * Eigen::Vector2d::Unit(axis));
      out += answer * answer.transpose();
    }
  return out;
}

/// Inverse of the information; what no sighting determines is listed, not inverted.
void invert_information(Refinement& out) {
  const Eigen::VectorXd scale =
      out.information.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd scaled = scale.asDiagonal() * out.information * scale.asDiagonal();
  const Eigen::LLT<Eigen::MatrixXd> llt(scaled);
  if (llt.info() == Eigen::Success && llt.rcond() > 100 * undetermined_eigenvalue) {
    out.covariance = scale.asDiagonal() *
                     llt.solve(Eigen::MatrixXd::Identity(scaled.rows(), scaled.cols())) *
                     scale.asDiagonal();
    out.covariance = 0.5 * (out.covariance + out.covariance.transpose()).eval();
    return;
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(scaled);
  Eigen::VectorXd inverse = eigen.eigenvalues();
  for (Eigen::Index i = 0; i < inverse.size(); ++i) {
    const bool known = inverse[i] > undetermined_eigenvalue;
    if (!known) out.undetermined.push_back(scale.asDiagonal() * eigen.eigenvectors().col(i));
    inverse[i] = known ? 1.0 / inverse[i] : 0.0;
  }
  const Eigen::MatrixXd half = scale.asDiagonal() * eigen.eigenvectors();
  out.covariance = half * inverse.asDiagonal() * half.transpose();
}

void measure_covariance(const Problem& p, const Linearisation& linear,
                        const NormalEquations& normal, Refinement& out) {
  const ReducedEquations reduced = eliminate_balls(normal, 0.0);
  out.information = reduced.information;
  invert_information(out);
  out.covariance += common_error_covariance(p, linear, normal, reduced, out);
  out.chi2 = cost(p.throws, out.residuals, out.weighting);
  int sightings = 0;
  for (const auto& used : out.weighting.used)
    sightings += static_cast<int>(std::count(used.begin(), used.end(), 1));
  out.degrees_of_freedom = 2 * sightings - free_parameters(out);
}

}  // namespace

Refinement refine(const RigDescription& rig, const std::vector<TimedThrow>& throws,
                  const Solution& start, const RefinementSettings& settings) {
  const Problem p{rig, throws, settings};
  Refinement out{.solution = start,
                 .layout = RigLayout(rig, start.rig),
                 .weighting = {all_placed(p, start.rig),
                               std::vector<double>(rig.cameras.size(), 1.0), settings.huber_sigmas},
                 .residuals = {},
                 .covariance = {},
                 .information = {},
                 .undetermined = {}};
  Linearised linear;
  linearise_at_solution(p, out, linear);
  out.residuals = linear.rows.residuals();
  // Where every sigma is stated and nothing lies beyond the gate there are no outliers to look for.
  const auto is_clean = [&] {
    bool clean = all_stated(rig);
    for_each(throws, [&](std::size_t j, std::size_t i, CameraId) {
      clean &= !out.weighting.used[j][i] || out.residuals[j][i].squaredNorm() <= settings.gate_chi2;
    });
    return clean;
  };
  if (!is_clean())
    descend(
        p, out, linear, near_enough_each * free_parameters(out),
        [&] { return follow_medians(p, out); }, is_clean);
  out.weighting.huber_sigmas = 0.0;
  for (std::size_t k = 0; k < rig.cameras.size(); ++k)
    if (rig.cameras[k].sigma_px) out.weighting.noise_scale[k] = 1.0;
  const auto settle = [&] {
    const bool chosen = gate(p, out), measured = measure_noise(p, out);
    return chosen || measured;
  };
  const auto last = descend(p, out, linear, at_optimum, settle, [] { return false; });
  const bool still_last = !settle() && last;
  if (!still_last) linearise_at_solution(p, out, linear);
  const NormalEquations normal =
      still_last
          ? *last
          : normal_equations(throws, linear.rows, out.solution.rig, out.layout, out.weighting);
  measure_covariance(p, linear.rows, normal, out);
  return out;
}

}  // namespace throwcal
