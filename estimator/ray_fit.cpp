// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/ray_fit.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

#include "estimator/elementary.h"

namespace throwcal {
namespace {

constexpr int max_steps = 30;
constexpr double enough_gain = 1e-3;  // of chi-square: a thirtieth of a sigma
constexpr double huber_sigmas = 2.0;

using Vector9d = Eigen::Matrix<double, 9, 1>;
using Matrix9d = Eigen::Matrix<double, 9, 9>;

/// Position at a ray's time and d position / d (velocity, gravity, drag).
struct Where {
  Eigen::Vector3d position;
  Eigen::Matrix3d J_velocity, J_gravity;
  Eigen::Vector3d J_drag;
};

/// State, and how it depends on drag, while marching.
struct March {
  BallState ball;
  Eigen::Vector3d J_position_drag = Eigen::Vector3d::Zero();
  Eigen::Vector3d J_velocity_drag = Eigen::Vector3d::Zero();
};

/// One Runge-Kutta step between two frames (under a micrometre of error at 12 m/s, 0.1 /m and 30
/// ms); drag's derivative by the midpoint rule, good to a few per cent.
void step(March& m, double h, const Eigen::Vector3d& gravity, double drag) {
  const auto slope = [&](const Eigen::Vector3d& v) -> Eigen::Vector3d {
    return gravity - drag * v.norm() * v;
  };
  const Eigen::Vector3d v1 = m.ball.velocity_mps, a1 = slope(v1);
  const Eigen::Vector3d v2 = v1 + 0.5 * h * a1, a2 = slope(v2);
  const Eigen::Vector3d v3 = v1 + 0.5 * h * a2, a3 = slope(v3);
  const Eigen::Vector3d v4 = v1 + h * a3, a4 = slope(v4);
  const Eigen::Vector3d pull = -v3.norm() * v3;
  m.J_position_drag += h * m.J_velocity_drag + 0.5 * h * h * pull;
  m.J_velocity_drag += h * pull;
  m.ball.position_m += h / 6.0 * (v1 + 2.0 * v2 + 2.0 * v3 + v4);
  m.ball.velocity_mps += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4);
}

/// Calls `take(ray index, state there)`, marching outwards from 0 so that each step is made once.
template <class Take>
void march(std::span<const TimedRay> rays, const FlightUnknowns& x, Take take) {
  constexpr double max_step_s = 0.03;
  const auto walk = [&](std::ptrdiff_t first, std::ptrdiff_t last, std::ptrdiff_t direction) {
    March m{x.ball};
    double time_s = 0.0;
    for (std::ptrdiff_t i = first; i != last; i += direction) {
      const double ahead_s = rays[i].time_s - time_s;
      const int steps = std::max(1, static_cast<int>(std::ceil(std::abs(ahead_s) / max_step_s)));
      for (int k = 0; k < steps; ++k) step(m, ahead_s / steps, x.gravity, x.drag);
      time_s = rays[i].time_s;
      take(i, m);
    }
  };
  const auto middle = std::partition_point(rays.begin(), rays.end(),
                                           [](const TimedRay& r) { return r.time_s < 0; }) -
                      rays.begin();
  walk(middle, std::ssize(rays), 1);
  walk(middle - 1, -1, -1);
}

Eigen::Vector3d position_without_drag(const FlightUnknowns& x, double t) {
  return x.ball.position_m + t * x.ball.velocity_mps + 0.5 * t * t * x.gravity;
}

std::vector<Eigen::Vector3d> positions(std::span<const TimedRay> rays, const FlightUnknowns& x) {
  std::vector<Eigen::Vector3d> out(rays.size());
  if (x.drag == 0.0)
    for (std::size_t i = 0; i < rays.size(); ++i) out[i] = position_without_drag(x, rays[i].time_s);
  else
    march(rays, x, [&](std::ptrdiff_t i, const March& m) { out[i] = m.ball.position_m; });
  return out;
}

/// Derivatives of those positions to first order in drag: their own error, (drag x speed x time)^2,
/// is at most a few per cent, which slows convergence a little and moves no solution.
std::vector<Where> linearised(std::span<const TimedRay> rays, const FlightUnknowns& x) {
  std::vector<Where> out(rays.size());
  const double speed = x.ball.velocity_mps.norm();
  Eigen::Matrix3d M = speed * Eigen::Matrix3d::Identity();
  if (speed > 1e-9) M += x.ball.velocity_mps * x.ball.velocity_mps.transpose() / speed;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const double t = rays[i].time_s, h = 0.5 * t * t;
    out[i] = {position_without_drag(x, t), t * Eigen::Matrix3d::Identity() - x.drag * h * M,
              h * Eigen::Matrix3d::Identity() - x.drag * t * h / 3.0 * M, Eigen::Vector3d::Zero()};
  }
  if (x.drag == 0.0 && !x.drags) return out;
  march(rays, x, [&](std::ptrdiff_t i, const March& m) {
    out[i].position = m.ball.position_m;
    out[i].J_drag = m.J_position_drag;
  });
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
  if (x.drags) sum += square((x.drag - problem.prior.drag) / problem.prior.sigma_drag);
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

RayEquations normal_equations(const RayProblem& problem, const FlightUnknowns& x, bool robust) {
  const std::vector<Where> where = linearised(problem.rays, x);
  const Eigen::Matrix<double, 3, 2> tilt = x.gravity.norm() * tangents(x.gravity);
  // Of fixed size for speed; the columns of what is known stay zero and are left out at the end.
  Matrix9d information = Matrix9d::Zero();
  Vector9d gradient = Vector9d::Zero();
  Eigen::Matrix<double, 2, 9> J = Eigen::Matrix<double, 2, 9>::Zero();
  const int drag_column = x.tilts ? 8 : 6;
  for (std::size_t i = 0; i < problem.rays.size(); ++i) {
    if (!problem.used[i]) continue;
    const double range = where[i].position.norm();
    const Eigen::Vector3d unit = where[i].position / range;
    const Eigen::Vector2d r = problem.rays[i].whitener * unit / problem.noise_scale;
    const Eigen::Matrix<double, 2, 3> by_position =
        (problem.rays[i].whitener / problem.noise_scale - r * unit.transpose()) / range;
    J.leftCols<3>() = by_position;
    J.middleCols<3>(3) = by_position * where[i].J_velocity;
    if (x.tilts) J.middleCols<2>(6) = by_position * where[i].J_gravity * tilt;
    if (x.drags) J.col(drag_column) = by_position * where[i].J_drag;
    const double norm = r.norm(), w = robust && norm > huber_sigmas ? huber_sigmas / norm : 1.0;
    const Eigen::Matrix<double, 9, 2> weighted = w * J.transpose();
    information += weighted.lazyProduct(J);  // too small for Eigen's blocked product to pay
    gradient.noalias() += w * (J.transpose() * r);
  }
  const int n = x.count();
  RayEquations out{information.topLeftCorner(n, n), gradient.head(n)};
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
    M += row.transpose().lazyProduct(row);
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
    M += row.transpose().lazyProduct(row);
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
    const RayEquations normal = normal_equations(problem, x, true);
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
    if (!better || gain < enough_gain) break;
  }
  return std::isfinite(best);
}

}  // namespace throwcal
