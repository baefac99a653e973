// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/refinement.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace throwcal {
namespace {

constexpr double undetermined_eigenvalue =
    1e-12;                                // of the scaled information: below it is rounding
constexpr double cost_tolerance = 1e-10;  // relative; far below one sigma squared
constexpr double max_damping = 1e8;
constexpr int gate_rounds = 8;

struct Problem {
  const RigDescription& rig;
  const std::vector<TimedThrow>& throws;
  const RefinementSettings& settings;
};

Solution stepped(const Solution& at, const NormalEquations& normal, const Eigen::VectorXd& step) {
  Solution out = at;
  out.rig.apply(step);
  for (std::size_t j = 0; j < out.balls.size(); ++j) {
    const NormalEquations::Ball& ball = normal.balls[j];
    const Eigen::Matrix<double, 6, 1> move =
        ball.inverse_information * (ball.gradient - ball.coupling.transpose() * step);
    out.balls[j].position_m += move.head<3>();
    out.balls[j].velocity_mps += move.tail<3>();
  }
  return out;
}

/// Levenberg-Marquardt in the free directions of the rig; the balls follow by back-substitution.
Solution minimise(const Problem& p, Solution at, const Weighting& weighting) {
  double damping = 1e-6, current = cost(p.rig, p.throws, at, weighting);
  for (int i = 0; i < p.settings.max_iterations; ++i) {
    const NormalEquations normal = normal_equations(p.rig, p.throws, at, weighting, damping);
    const Eigen::MatrixXd free = gauge_directions(p.rig, at.rig);
    const Eigen::MatrixXd information = free.transpose() * normal.information * free;
    const Eigen::VectorXd scale = information.diagonal().cwiseMax(1e-12).cwiseSqrt().cwiseInverse();
    const Eigen::VectorXd solved =
        (scale.asDiagonal() * information * scale.asDiagonal())
            .ldlt()
            .solve(scale.asDiagonal() * (free.transpose() * normal.gradient));
    const Solution next = stepped(at, normal, free * (scale.asDiagonal() * solved));
    const double reached = cost(p.rig, p.throws, next, weighting);
    if (reached <= current) {  // false for NaN too
      const bool done = current - reached <= cost_tolerance * current + 1e-12;
      at = next, current = reached, damping = std::max(0.1 * damping, 1e-12);
      if (done) break;
    } else {
      if (reached - current <= cost_tolerance * current || damping > max_damping) break;
      damping *= 10;
    }
  }
  return at;
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

/// Each camera's robust noise in units of what is claimed: 1.4826 x the median absolute residual,
/// outliers and all.
std::vector<double> median_scales(const Problem& p, const PerSighting<Eigen::Vector2d>& whitened,
                                  const Weighting& now) {
  std::vector<std::vector<double>> sizes(p.rig.cameras.size());
  for_each(p.throws, [&](std::size_t j, std::size_t i, CameraId k) {
    if (now.used[j][i] && whitened[j][i].allFinite())
      for (int c = 0; c < 2; ++c)
        sizes[k].push_back(std::abs(whitened[j][i][c]) * now.noise_scale[k]);
  });
  std::vector<double> scales;
  for (const auto& camera : sizes) scales.push_back(std::max(1.4826 * median(camera), 1e-6));
  return scales;
}

int free_parameters(const Problem& p, const Solution& at, const Weighting& weighting) {
  int balls = 0;
  for (const auto& used : weighting.used)
    balls += std::any_of(used.begin(), used.end(), [](char u) { return u; });
  return static_cast<int>(gauge_directions(p.rig, at.rig).cols()) + slice::ball_size * balls;
}

/// Each camera's noise from its residuals' mean square, corrected for what the fit took; the claim
/// stands where stated.
std::vector<double> rms_scales(const Problem& p, const Solution& at, const Weighting& now) {
  const auto whitened = whitened_residuals(p.rig, p.throws, at, now.noise_scale);
  std::vector<double> sum(p.rig.cameras.size(), 0.0), count(sum);
  double total = 0.0;
  for_each(p.throws, [&](std::size_t j, std::size_t i, CameraId k) {
    if (!now.used[j][i] || !whitened[j][i].allFinite()) return;
    sum[k] += whitened[j][i].squaredNorm(), count[k] += 2, total += 2;
  });
  const double kept = 1.0 - free_parameters(p, at, now) / total;
  std::vector<double> scales = now.noise_scale;
  for (std::size_t k = 0; k < scales.size(); ++k)
    if (!p.rig.cameras[k].sigma_px && count[k] > 0 && kept > 0)
      scales[k] = std::max(now.noise_scale[k] * std::sqrt(sum[k] / (count[k] * kept)), 1e-6);
  return scales;
}

Weighting start_weighting(const Problem& p, const Solution& at) {
  Weighting out{{}, std::vector<double>(p.rig.cameras.size(), 1.0), 0.0};
  for (const TimedThrow& thrown : p.throws) {
    out.used.emplace_back();
    for (const TimedSighting& s : thrown.sightings)
      out.used.back().push_back(at.rig.is_placed[s.camera]);
  }
  return out;
}

/// Robust fit with the noise scale following the residuals down: from a rough start nearly
/// everything is "far", and a fixed threshold would turn the problem into the slow L1 one. Stated
/// sigmas only ever widen here.
Solution fit_robustly(const Problem& p, Solution at, Weighting& weighting) {
  weighting.huber_sigmas = p.settings.huber_sigmas;
  for (int round = 0; round < 6; ++round) {
    const auto scales =
        median_scales(p, whitened_residuals(p.rig, p.throws, at, weighting.noise_scale), weighting);
    double change = 0.0;
    for (std::size_t k = 0; k < scales.size(); ++k) {
      const double scale = p.rig.cameras[k].sigma_px ? std::max(1.0, scales[k]) : scales[k];
      change = std::max(change, std::abs(std::log(scale / weighting.noise_scale[k])));
      weighting.noise_scale[k] = scale;
    }
    at = minimise(p, at, weighting);
    if (change < 0.05) break;
  }
  weighting.huber_sigmas = 0.0;
  for (std::size_t k = 0; k < weighting.noise_scale.size(); ++k)
    if (p.rig.cameras[k].sigma_px) weighting.noise_scale[k] = 1.0;
  return at;
}

/// Takes out what lies beyond the gate, and throws that are left with too little to fix their ball.
/// Returns whether the choice changed.
bool gate(const Problem& p, const Solution& at, Weighting& weighting) {
  const auto whitened = whitened_residuals(p.rig, p.throws, at, weighting.noise_scale);
  PerSighting<char> used = start_weighting(p, at).used;
  double gated = 0.0, total = 0.0;
  for_each(p.throws, [&](std::size_t j, std::size_t i, CameraId) {
    if (!used[j][i]) return;
    used[j][i] = whitened[j][i].squaredNorm() <= p.settings.gate_chi2;  // false for NaN
    gated += !used[j][i], total += 1;
  });
  const bool stated = std::any_of(p.rig.cameras.begin(), p.rig.cameras.end(),
                                  [](const auto& c) { return c.sigma_px.has_value(); });
  if (stated && gated > p.settings.max_gated * total) used = start_weighting(p, at).used;
  for (auto& thrown : used)
    if (std::count(thrown.begin(), thrown.end(), 1) < 4) std::fill(thrown.begin(), thrown.end(), 0);
  const bool changed = used != weighting.used;
  weighting.used = std::move(used);
  return changed;
}

/// What the errors that a camera's sightings share add to the covariance: the solution's answer to
/// all of them shifted by one sigma along each axis ("consider" covariance). Averaging over a
/// thousand sightings does not lower it, so leaving it out would promise tenths of a millimetre
/// that a lit side of the ball takes back.
Eigen::MatrixXd common_error_covariance(const Problem& p, const Refinement& at,
                                        const NormalEquations& normal) {
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(at.covariance.rows(), at.covariance.cols());
  for (CameraId k = 0; k < p.rig.cameras.size(); ++k)
    for (int axis = 0; axis < 2; ++axis) {
      const double sigma_px = p.rig.cameras[k].sigma_common_px;
      if (!(sigma_px > 0) || !at.solution.rig.is_placed[k]) continue;
      std::vector<TimedThrow> shifted = p.throws;
      for (TimedThrow& thrown : shifted)
        for (TimedSighting& s : thrown.sightings)
          if (s.camera == k) s.pixel[axis] += sigma_px;
      const Eigen::VectorXd gradient =
          normal_equations(p.rig, shifted, at.solution, at.weighting, 0.0).gradient;
      const Eigen::VectorXd moved = at.covariance * (gradient - normal.gradient);
      out += moved * moved.transpose();
    }
  return out;
}

/// Inverse of the information in the free directions; what no sighting determines is listed, not
/// inverted.
void measure_covariance(const Problem& p, Refinement& out) {
  const NormalEquations normal =
      normal_equations(p.rig, p.throws, out.solution, out.weighting, 0.0);
  const Eigen::MatrixXd free = gauge_directions(p.rig, out.solution.rig);
  const Eigen::MatrixXd information = free.transpose() * normal.information * free;
  const Eigen::VectorXd scale = information.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(scale.asDiagonal() * information *
                                                             scale.asDiagonal());
  Eigen::VectorXd inverse = eigen.eigenvalues();
  for (Eigen::Index i = 0; i < inverse.size(); ++i) {
    const bool known = inverse[i] > undetermined_eigenvalue;
    if (!known)
      out.undetermined.push_back(free * (scale.asDiagonal() * eigen.eigenvectors().col(i)));
    inverse[i] = known ? 1.0 / inverse[i] : 0.0;
  }
  const Eigen::MatrixXd half = free * scale.asDiagonal() * eigen.eigenvectors();
  out.covariance = half * inverse.asDiagonal() * half.transpose();
  out.covariance += common_error_covariance(p, out, normal);
  out.chi2 = normal.cost;
  out.degrees_of_freedom = 2 * normal.sightings - free_parameters(p, out.solution, out.weighting);
}

}  // namespace

Refinement refine(const RigDescription& rig, const std::vector<TimedThrow>& throws,
                  const Solution& start, const RefinementSettings& settings) {
  const Problem p{rig, throws, settings};
  Refinement out{start, start_weighting(p, start), {}, {}, {}, 0.0, 0};
  out.solution = fit_robustly(p, start, out.weighting);
  for (int round = 0; round < gate_rounds; ++round) {
    const bool changed = gate(p, out.solution, out.weighting);
    const auto before = out.weighting.noise_scale;
    out.weighting.noise_scale = rms_scales(p, out.solution, out.weighting);
    out.solution = minimise(p, out.solution, out.weighting);
    double moved = 0.0;
    for (std::size_t k = 0; k < before.size(); ++k)
      moved = std::max(moved, std::abs(out.weighting.noise_scale[k] / before[k] - 1));
    if (!changed && moved < 1e-6) break;
  }
  out.whitened = whitened_residuals(rig, throws, out.solution, out.weighting.noise_scale);
  measure_covariance(p, out);
  return out;
}

}  // namespace throwcal
