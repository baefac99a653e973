// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/flight_alignment.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

#include "estimator/elementary.h"

namespace throwcal {
namespace {

using Vector5d = Eigen::Matrix<double, 5, 1>;
using Matrix5d = Eigen::Matrix<double, 5, 5>;
using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

constexpr int max_steps = 15;
constexpr std::size_t most_tried = 16, most_weighed = 24;

double common_moment_s(const CameraFlight& a, const CameraFlight& b, double b_epoch_on_a_s) {
  const double low = std::max(a.first_s, b.first_s + b_epoch_on_a_s);
  const double high = std::min(a.last_s, b.last_s + b_epoch_on_a_s);
  return 0.5 * (low + high);  // of the gap, where they do not overlap
}

/// A start from the pairs picked: offset from apexes, heading from horizontal velocities and from
/// where the flights are to one another, translation from the means.
CameraAlignment first_guess(std::span<const FlightPair> pairs, const std::vector<bool>& picked,
                            const AlignmentSettings& settings) {
  CameraAlignment out;
  out.slack_rad = settings.slack_rad;
  out.slack_mps = settings.slack_mps;
  double count = 0.0;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (!picked[i]) continue;
    const auto& [a, b] = pairs[i];
    out.offset_b_minus_a_s += apex_s(a) - apex_s(b) - seconds(b.epoch - a.epoch);
    ++count;
  }
  out.offset_b_minus_a_s = settings.estimate_offset ? out.offset_b_minus_a_s / count : 0.0;

  struct Level {
    BallState a, b;
  };
  std::vector<Level> levels;
  Eigen::Matrix3d L_a = Eigen::Matrix3d::Identity(), L_b = L_a;
  Eigen::Vector3d mean_a = Eigen::Vector3d::Zero(), mean_b = mean_a;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (!picked[i]) continue;
    const auto& [a, b] = pairs[i];
    L_a = level_rotation(a.gravity_cam_mps2);
    L_b = level_rotation(b.gravity_cam_mps2);
    const double shift = seconds(b.epoch - a.epoch) + out.offset_b_minus_a_s;
    const double t = common_moment_s(a, b, shift);
    const BallState s_a = a.at(t), s_b = b.at(t - shift);
    levels.push_back({{L_a * s_a.position_m, L_a * s_a.velocity_mps},
                      {L_b * s_b.position_m, L_b * s_b.velocity_mps}});
    mean_a += levels.back().a.position_m / count;
    mean_b += levels.back().b.position_m / count;
  }
  double dot = 0.0, cross = 0.0;
  const auto agree = [&](const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
    dot += a.x() * b.x() + a.y() * b.y();
    cross += a.y() * b.x() - a.x() * b.y();
  };
  for (const Level& s : levels) {
    agree(s.a.velocity_mps, s.b.velocity_mps);
    agree(s.a.position_m - mean_a, s.b.position_m - mean_b);
  }
  const Rigid heading{exp_so3({0, 0, elementary::atan2(cross, dot)}), Eigen::Vector3d::Zero()};
  out.T_a_b = Rigid{L_a.transpose(), Eigen::Vector3d::Zero()} *
              Rigid{heading.rotation, mean_a - heading.rotation * mean_b} *
              Rigid{L_b, Eigen::Vector3d::Zero()};
  return out;
}

/// Weighted least squares over the pairs picked. False where they leave a direction open.
bool refine(std::span<const FlightPair> pairs, const std::vector<bool>& picked,
            const AlignmentSettings& settings, CameraAlignment& x) {
  const int n = settings.estimate_offset ? 5 : 4;
  for (int step = 0; step < max_steps; ++step) {
    Matrix5d H = Matrix5d::Zero();
    Vector5d gradient = Vector5d::Zero();
    Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
    x.chi2 = 0.0;
    for (std::size_t i = 0; i < pairs.size(); ++i) {
      if (!picked[i]) continue;
      const FlightDifference d = difference(x, pairs[i].first, pairs[i].second);
      const Eigen::Matrix<double, 5, 6> weighted = d.covariance.ldlt().solve(d.J).transpose();
      H += weighted * d.J;
      gradient += weighted * d.value;
      x.chi2 += d.chi2();
      up = -pairs[i].first.gravity_cam_mps2.normalized();
    }
    const Eigen::MatrixXd used_H = H.topLeftCorner(n, n);
    const Eigen::VectorXd size = used_H.diagonal().cwiseSqrt();
    if (!(size.minCoeff() > 0) || !used_H.allFinite()) return false;
    const Eigen::MatrixXd unit =
        size.cwiseInverse().asDiagonal() * used_H * size.cwiseInverse().asDiagonal();
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(unit);
    if (eigen.info() != Eigen::Success || !(eigen.eigenvalues()[0] > 1e-12)) return false;
    const Eigen::MatrixXd root = size.cwiseInverse().asDiagonal() * eigen.eigenvectors() *
                                 eigen.eigenvalues().cwiseSqrt().cwiseInverse().asDiagonal();
    x.covariance.setZero();
    x.covariance.topLeftCorner(n, n) = root * root.transpose();
    const Vector5d d = -(x.covariance * gradient);
    x.T_a_b.rotation = nearest_rotation(exp_so3(d[0] * up) * x.T_a_b.rotation);
    x.T_a_b.translation += d.segment<3>(1);
    x.offset_b_minus_a_s += d[4];
    if (!x.T_a_b.translation.allFinite() || !x.T_a_b.rotation.allFinite()) return false;
    if (d.dot(H * d) < 1e-8) break;
  }
  return std::abs(x.offset_b_minus_a_s) <= settings.max_offset_s &&
         std::sqrt(x.covariance(0, 0)) < settings.max_sigma_heading_rad;
}

std::vector<double> mismatches(std::span<const FlightPair> pairs, const CameraAlignment& x) {
  std::vector<double> out;
  for (const auto& [a, b] : pairs) out.push_back(mismatch_chi2(x, a, b));
  return out;
}

std::vector<bool> within(double gate, const std::vector<double>& chi2) {
  std::vector<bool> out;
  for (double value : chi2) out.push_back(value <= gate);
  return out;
}

double truncated_sum(const std::vector<double>& chi2, double gate) {
  double sum = 0.0;
  for (double value : chi2) sum += std::min(value, gate);
  return sum;
}

/// All pairs, each alone, and each two neighbours together (two drops at different places have a
/// heading that neither has alone). Of many pairs some, spread over all: that none of them is right
/// where most pairs are does not happen.
std::vector<std::vector<bool>> hypotheses(std::size_t count) {
  std::vector<std::vector<bool>> out{std::vector<bool>(count, true)};
  const std::size_t tried = count > 1 ? std::min(count, most_tried) : 0;
  for (std::size_t n = 0; n < tried; ++n) {
    const std::size_t i = n * count / tried;
    out.emplace_back(count, false)[i] = true;
    out.push_back(out.back());
    out.back()[(i + 1) % count] = true;
  }
  return out;
}

}  // namespace

double FlightDifference::chi2() const { return value.dot(covariance.ldlt().solve(value)); }

FlightDifference difference(const CameraAlignment& at, const CameraFlight& a,
                            const CameraFlight& b) {
  const double b_epoch_on_a_s = seconds(b.epoch - a.epoch) + at.offset_b_minus_a_s;
  const double t_a = common_moment_s(a, b, b_epoch_on_a_s), t_b = t_a - b_epoch_on_a_s;
  const BallState in_a = a.at(t_a), in_b = b.at(t_b);
  const Eigen::Matrix3d& R = at.T_a_b.rotation;
  const Eigen::Vector3d up = -a.gravity_cam_mps2.normalized();
  const Eigen::Vector3d position = R * in_b.position_m, velocity = R * in_b.velocity_mps;
  const Eigen::Vector3d acceleration =
      R * (b.gravity_cam_mps2 - b.drag_per_m * in_b.velocity_mps.norm() * in_b.velocity_mps);

  FlightDifference out;
  out.value << in_a.position_m - position - at.T_a_b.translation, in_a.velocity_mps - velocity;
  Matrix6d turn = Matrix6d::Zero();
  turn.topLeftCorner<3, 3>() = R;
  turn.bottomRightCorner<3, 3>() = R;
  out.covariance = a.covariance_at(t_a) + turn * b.covariance_at(t_b) * turn.transpose();
  const double floor2 =
      at.slack_rad * at.slack_rad * (in_a.position_m.squaredNorm() + in_b.position_m.squaredNorm());
  out.covariance.diagonal().head<3>().array() += floor2;
  out.covariance.diagonal().tail<3>().array() += 2 * at.slack_mps * at.slack_mps;
  out.J.setZero();
  out.J.block<3, 1>(0, 0) = -up.cross(position);
  out.J.block<3, 1>(3, 0) = -up.cross(velocity);
  out.J.block<3, 3>(0, 1) = -Eigen::Matrix3d::Identity();
  out.J.block<3, 1>(0, 4) = velocity;
  out.J.block<3, 1>(3, 4) = acceleration;
  return out;
}

double apex_s(const CameraFlight& flight) {
  const Eigen::Vector3d up = -flight.gravity_cam_mps2.normalized();
  const double g = flight.gravity_cam_mps2.norm();
  double t = 0.0;
  for (int i = 0; i < 4; ++i) {
    const double climb = flight.at(t).velocity_mps.dot(up);
    t = std::clamp(t + climb / g, -2.0, 2.0);
    if (std::abs(climb) < 1e-9 || flight.drag_per_m == 0.0) break;
  }
  return t;
}

Eigen::Matrix3d level_rotation(const Eigen::Vector3d& gravity_cam) {
  const Eigen::Vector3d up = -gravity_cam.normalized();
  const Eigen::Vector3d side =
      std::abs(up.x()) < 0.8 ? Eigen::Vector3d::UnitX() : Eigen::Vector3d::UnitZ();
  Eigen::Matrix3d L;
  L.row(0) = (side - side.dot(up) * up).normalized();
  L.row(2) = up;
  L.row(1) = L.row(2).cross(L.row(0));
  return L;
}

double mismatch_chi2(const CameraAlignment& alignment, const CameraFlight& a,
                     const CameraFlight& b) {
  FlightDifference d = difference(alignment, a, b);
  d.covariance += d.J * alignment.covariance * d.J.transpose();
  const double chi2 = d.chi2();
  return std::isfinite(chi2) ? chi2 : std::numeric_limits<double>::infinity();
}

std::optional<CameraAlignment> align_cameras(std::span<const FlightPair> shared,
                                             const AlignmentSettings& settings) {
  if (shared.empty()) return std::nullopt;
  if (shared.size() > most_weighed) {
    std::vector<FlightPair> spread;
    for (std::size_t n = 0; n < most_weighed; ++n)
      spread.push_back(shared[n * shared.size() / most_weighed]);
    auto found = align_cameras(spread, settings);
    if (found) found->used = within(settings.gate_chi2, mismatches(shared, *found));
    return found;
  }
  std::optional<CameraAlignment> best;
  double lowest = std::numeric_limits<double>::infinity();
  for (const std::vector<bool>& picked : hypotheses(shared.size())) {
    CameraAlignment x = first_guess(shared, picked, settings);
    if (!refine(shared, picked, settings, x)) continue;
    const std::vector<double> chi2 = mismatches(shared, x);
    const double sum = truncated_sum(chi2, settings.gate_chi2);
    if (sum >= lowest) continue;
    lowest = sum;
    best = x;
    best->used = picked;
    // All agree: no subset explains more. (The first hypothesis is all pairs.)
    if (std::ranges::max(chi2) <= settings.gate_chi2) break;
  }
  for (int round = 0; best && round < 3; ++round) {
    const auto used = within(settings.gate_chi2, mismatches(shared, *best));
    if (used == best->used) break;
    best->used = used;
    if (std::ranges::count(used, true) == 0 || !refine(shared, used, settings, *best)) best.reset();
  }
  return best;
}

}  // namespace throwcal
