// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/ray_fit.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

namespace throwcal {
namespace {

constexpr int max_steps = 30;
constexpr double huber_sigmas = 2.0;

using Vector9d = Eigen::Matrix<double, 9, 1>;
using Matrix9d = Eigen::Matrix<double, 9, 9>;

/// Position at a ray's time and d position / d (velocity, gravity, drag).
struct Where {
  Eigen::Vector3d position;
  Eigen::Matrix3d J_velocity, J_gravity;
  Eigen::Vector3d J_drag;
};

/// Positions at the rays' times, marching outwards from 0 so that each step is made once.
std::vector<Eigen::Vector3d> positions(std::span<const TimedRay> rays, const FlightUnknowns& x) {
  std::vector<Eigen::Vector3d> out(rays.size());
  const auto walk = [&](std::ptrdiff_t first, std::ptrdiff_t last, std::ptrdiff_t step) {
    BallState ball = x.ball;
    double time_s = 0.0;
    for (std::ptrdiff_t i = first; i != last; i += step) {
      const double t = rays[i].time_s;
      // Without drag each is one exact step from the epoch.
      ball =
          x.drag == 0.0 ? fly(x.ball, t, x.gravity, 0.0) : fly(ball, t - time_s, x.gravity, x.drag);
      time_s = t;
      out[i] = ball.position_m;
    }
  };
  const auto middle = std::partition_point(rays.begin(), rays.end(),
                                           [](const TimedRay& r) { return r.time_s < 0; }) -
                      rays.begin();
  walk(middle, std::ssize(rays), 1);
  walk(middle - 1, -1, -1);
  return out;
}

/// Derivatives of those positions to first order in drag: their own error, (drag x speed x time)^2,
/// is at most a few per cent, which slows convergence a little and moves no solution.
std::vector<Where> linearised(std::span<const TimedRay> rays, const FlightUnknowns& x) {
  const std::vector<Eigen::Vector3d> here = positions(rays, x);
  std::vector<Where> out(rays.size());
  const double speed = x.ball.velocity_mps.norm();
  Eigen::Matrix3d M = speed * Eigen::Matrix3d::Identity();
  if (speed > 1e-9) M += x.ball.velocity_mps * x.ball.velocity_mps.transpose() / speed;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const double t = rays[i].time_s, h = 0.5 * t * t;
    out[i] = {here[i], t * Eigen::Matrix3d::Identity() - x.drag * h * M,
              h * Eigen::Matrix3d::Identity() - x.drag * t * h / 3.0 * M, Eigen::Vector3d::Zero()};
  }
  if (!x.drags) return out;
  constexpr double step_per_m = 1e-4;
  FlightUnknowns more = x;
  more.drag += step_per_m;
  const std::vector<Eigen::Vector3d> there = positions(rays, more);
  for (std::size_t i = 0; i < rays.size(); ++i) out[i].J_drag = (there[i] - here[i]) / step_per_m;
  return out;
}

double huber_cost(double r2) {
  constexpr double k = huber_sigmas;
  return r2 < k * k ? r2 : 2 * k * std::sqrt(r2) - k * k;
}

/// How far gravity lies off its prior along its own two tilts, in sigmas.
Eigen::Vector2d gravity_error(const FlightPrior& prior, const FlightUnknowns& x) {
  return -tangents(x.gravity).transpose() * prior.gravity.normalized() / prior.sigma_gravity_rad;
}

double cost(const RayProblem& problem, const FlightUnknowns& x) {
  const std::vector<double> r2 = squared_residuals(problem.rays, x);
  double sum = 0.0;
  for (std::size_t i = 0; i < r2.size(); ++i)
    if (problem.used[i]) sum += huber_cost(r2[i] / (problem.noise_scale * problem.noise_scale));
  if (x.drags) sum += std::pow((x.drag - problem.prior.drag) / problem.prior.sigma_drag, 2);
  if (x.tilts && problem.prior.sigma_gravity_rad > 0)
    sum += gravity_error(problem.prior, x).squaredNorm();
  return sum;
}

FlightUnknowns stepped(const FlightUnknowns& x, const Eigen::VectorXd& d) {
  FlightUnknowns out = x;
  out.ball.position_m += d.head<3>();
  out.ball.velocity_mps += d.segment<3>(3);
  if (x.tilts) {
    const double g = x.gravity.norm();
    out.gravity = g * (x.gravity / g + tangents(x.gravity) * d.segment<2>(6)).normalized();
  }
  if (x.drags) out.drag = std::clamp(x.drag + d[d.size() - 1], 0.0, 1.0);
  return out;
}

}  // namespace

Eigen::Matrix<double, 3, 2> tangents(const Eigen::Vector3d& v) {
  const Eigen::Vector3d unit = v.normalized();
  const Eigen::Vector3d other =
      std::abs(unit.x()) < 0.6 ? Eigen::Vector3d::UnitX() : Eigen::Vector3d::UnitY();
  Eigen::Matrix<double, 3, 2> basis;
  basis.col(0) = unit.cross(other).normalized();
  basis.col(1) = unit.cross(basis.col(0));
  return basis;
}

std::vector<double> squared_residuals(std::span<const TimedRay> rays, const FlightUnknowns& x) {
  const std::vector<Eigen::Vector3d> where = positions(rays, x);
  std::vector<double> out(rays.size());
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const Eigen::Vector3d& p = where[i];
    out[i] = p.dot(rays[i].direction_cam) > 0 ? (rays[i].whitener * p.normalized()).squaredNorm()
                                              : std::numeric_limits<double>::infinity();
  }
  return out;
}

NormalEquations normal_equations(const RayProblem& problem, const FlightUnknowns& x, bool robust) {
  const int n = x.count();
  NormalEquations out{Eigen::MatrixXd::Zero(n, n), Eigen::VectorXd::Zero(n)};
  const std::vector<Where> where = linearised(problem.rays, x);
  const Eigen::Matrix<double, 3, 2> tilt = x.gravity.norm() * tangents(x.gravity);
  Eigen::Matrix<double, 2, 9> J;
  for (std::size_t i = 0; i < problem.rays.size(); ++i) {
    if (!problem.used[i]) continue;
    const double range = where[i].position.norm();
    const Eigen::Vector3d unit = where[i].position / range;
    const Eigen::Vector2d r = problem.rays[i].whitener * unit / problem.noise_scale;
    const Eigen::Matrix<double, 2, 3> by_position =
        (problem.rays[i].whitener - problem.rays[i].whitener * unit * unit.transpose()) /
        (range * problem.noise_scale);
    J.leftCols<3>() = by_position;
    J.middleCols<3>(3) = by_position * where[i].J_velocity;
    if (x.tilts) J.middleCols<2>(6) = by_position * where[i].J_gravity * tilt;
    if (x.drags) J.col(n - 1) = by_position * where[i].J_drag;
    const double norm = r.norm(), w = robust && norm > huber_sigmas ? huber_sigmas / norm : 1.0;
    out.information.noalias() += w * J.leftCols(n).transpose() * J.leftCols(n);
    out.gradient.noalias() += w * J.leftCols(n).transpose() * r;
  }
  if (x.drags) {
    const double w = 1.0 / (problem.prior.sigma_drag * problem.prior.sigma_drag);
    out.information(n - 1, n - 1) += w;
    out.gradient[n - 1] += w * (x.drag - problem.prior.drag);
  }
  if (x.tilts && problem.prior.sigma_gravity_rad > 0) {
    const double sigma = problem.prior.sigma_gravity_rad;
    out.information.diagonal().segment<2>(6).array() += 1.0 / (sigma * sigma);
    out.gradient.segment<2>(6) += gravity_error(problem.prior, x) / sigma;
  }
  return out;
}

std::optional<FlightUnknowns> closed_form(std::span<const TimedRay> rays,
                                          std::span<const std::size_t> picked,
                                          double gravity_mps2) {
  double span_s = 0.0;
  for (const std::size_t i : picked) span_s = std::max(span_s, std::abs(rays[i].time_s));
  if (span_s <= 0.0) return std::nullopt;
  Matrix9d M = Matrix9d::Zero();
  for (const std::size_t i : picked) {
    const double t = rays[i].time_s / span_s;
    Eigen::Matrix<double, 2, 9> row;
    row << rays[i].whitener, t * rays[i].whitener, 0.5 * t * t * rays[i].whitener;
    M.noalias() += row.transpose() * row;
  }
  const Eigen::SelfAdjointEigenSolver<Matrix9d> solver(M);
  if (solver.info() != Eigen::Success) return std::nullopt;
  Vector9d v = solver.eigenvectors().col(0);
  v.segment<3>(3) /= span_s;
  v.tail<3>() /= span_s * span_s;
  const double length = v.tail<3>().norm();
  if (!(length > 1e-9 * v.norm())) return std::nullopt;
  v *= gravity_mps2 / length;
  double ahead = 0.0;
  for (const std::size_t i : picked)
    ahead += rays[i].direction_cam.dot(v.head<3>() + rays[i].time_s * v.segment<3>(3) +
                                       0.5 * rays[i].time_s * rays[i].time_s * v.tail<3>());
  if (ahead < 0) v = -v;
  if (!v.allFinite()) return std::nullopt;
  return FlightUnknowns{{v.head<3>(), v.segment<3>(3)}, v.tail<3>()};
}

std::optional<FlightUnknowns> linear_form(std::span<const TimedRay> rays,
                                          std::span<const std::size_t> picked,
                                          const Eigen::Vector3d& gravity) {
  Eigen::Matrix<double, 6, 6> M = Eigen::Matrix<double, 6, 6>::Zero();
  Eigen::Matrix<double, 6, 1> b = Eigen::Matrix<double, 6, 1>::Zero();
  for (const std::size_t i : picked) {
    const double t = rays[i].time_s;
    Eigen::Matrix<double, 2, 6> row;
    row << rays[i].whitener, t * rays[i].whitener;
    M.noalias() += row.transpose() * row;
    b.noalias() -= row.transpose() * (rays[i].whitener * (0.5 * t * t * gravity));
  }
  const Eigen::Matrix<double, 6, 1> v = M.ldlt().solve(b);
  if (!v.allFinite()) return std::nullopt;
  FlightUnknowns out{{v.head<3>(), v.tail<3>()}, gravity};
  out.tilts = false;
  return out;
}

bool descend(const RayProblem& problem, FlightUnknowns& x) {
  double best = cost(problem, x), damping = 1e-6;
  for (int i = 0; i < max_steps && std::isfinite(best); ++i) {
    const NormalEquations normal = normal_equations(problem, x, true);
    bool better = false;
    double gain = 0.0;
    while (!better && damping < 1e6) {
      Eigen::MatrixXd damped = normal.information;
      damped.diagonal() *= 1.0 + damping;
      const FlightUnknowns next = stepped(x, -damped.ldlt().solve(normal.gradient));
      const double c = next.ball.position_m.allFinite() && next.ball.velocity_mps.allFinite() &&
                               next.ball.velocity_mps.norm() < 1e3
                           ? cost(problem, next)
                           : std::numeric_limits<double>::infinity();
      better = c <= best;
      if (better) {
        gain = best - c;
        best = c;
        x = next;
        damping = std::max(damping * 0.1, 1e-9);
      } else {
        damping = std::max(damping * 10.0, 1e-4);
      }
    }
    if (!better || gain < 1e-6 * (1.0 + best)) break;
  }
  return std::isfinite(best);
}

}  // namespace throwcal
