// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/flight_fit.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>

namespace throwcal {
namespace {

constexpr int max_steps = 30;
constexpr double huber_sigmas = 2.0;
constexpr double median_chi2_2dof = 1.3862944;  // of two unit normals' squared sum

/// Parameters of one fit: position, velocity, two tilts of gravity, drag; the last three only where
/// they are unknown.
struct Unknowns {
  BallState ball;
  Eigen::Vector3d gravity;
  double drag = 0.0;
  bool tilts = true, drags = false;

  int count() const { return 6 + (tilts ? 2 : 0) + (drags ? 1 : 0); }
};

/// Two unit vectors square to `v`.
Eigen::Matrix<double, 3, 2> tangents(const Eigen::Vector3d& v) {
  const Eigen::Vector3d unit = v.normalized();
  const Eigen::Vector3d other =
      std::abs(unit.x()) < 0.6 ? Eigen::Vector3d::UnitX() : Eigen::Vector3d::UnitY();
  Eigen::Matrix<double, 3, 2> basis;
  basis.col(0) = unit.cross(other).normalized();
  basis.col(1) = unit.cross(basis.col(0));
  return basis;
}

using Vector9d = Eigen::Matrix<double, 9, 1>;
using Matrix9d = Eigen::Matrix<double, 9, 9>;

/// Position at a ray's time and d position / d (velocity, gravity, drag).
struct Where {
  Eigen::Vector3d position;
  Eigen::Matrix3d J_velocity, J_gravity;
  Eigen::Vector3d J_drag;
};

/// Marches over the rays' times outwards from 0, so that each step of the integration is made once.
std::vector<Where> march(std::span<const TimedRay> rays, const Unknowns& x) {
  std::vector<Where> out(rays.size());
  const auto exact = [&](std::size_t i) {
    const double t = rays[i].time_s;
    out[i] = {x.ball.position_m + t * x.ball.velocity_mps + 0.5 * t * t * x.gravity,
              t * Eigen::Matrix3d::Identity(), 0.5 * t * t * Eigen::Matrix3d::Identity(),
              Eigen::Vector3d::Zero()};
  };
  if (x.drag == 0.0 && !x.drags) {
    for (std::size_t i = 0; i < rays.size(); ++i) exact(i);
    return out;
  }
  const auto walk = [&](auto first, auto last, auto step) {
    Propagation now{x.ball, Eigen::Matrix3d::Zero(), Eigen::Matrix3d::Identity(),
                    Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()};
    double time_s = 0.0;
    for (auto i = first; i != last; i += step) {
      const double t = rays[i].time_s;
      const Propagation p = propagate(now.state, t - time_s, x.gravity, x.drag);
      now = {p.state, now.J_position_velocity0 + p.J_position_velocity0 * now.J_velocity_velocity0,
             p.J_velocity_velocity0 * now.J_velocity_velocity0,
             now.J_position_drag + p.J_position_velocity0 * now.J_velocity_drag + p.J_position_drag,
             p.J_velocity_velocity0 * now.J_velocity_drag + p.J_velocity_drag};
      time_s = t;
      // Gravity's derivative without drag: off by drag x speed x time, a few per cent, which only
      // slows convergence.
      out[i] = {now.state.position_m, now.J_position_velocity0,
                0.5 * t * t * Eigen::Matrix3d::Identity(), now.J_position_drag};
    }
  };
  const auto middle = static_cast<std::ptrdiff_t>(
      std::partition_point(rays.begin(), rays.end(),
                           [](const TimedRay& r) { return r.time_s < 0; }) -
      rays.begin());
  walk(middle, static_cast<std::ptrdiff_t>(rays.size()), std::ptrdiff_t{1});
  walk(middle - 1, std::ptrdiff_t{-1}, std::ptrdiff_t{-1});
  return out;
}

/// Whitened squared residual of each ray; infinite where the ball would be behind the ray.
std::vector<double> squared_residuals(std::span<const TimedRay> rays, const Unknowns& x) {
  const std::vector<Where> where = march(rays, x);
  std::vector<double> out(rays.size());
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const Eigen::Vector3d& p = where[i].position;
    out[i] = p.dot(rays[i].direction_cam) > 0 ? (rays[i].whitener * p.normalized()).squaredNorm()
                                              : std::numeric_limits<double>::infinity();
  }
  return out;
}

double huber_cost(double r2) {
  constexpr double k = huber_sigmas;
  return r2 < k * k ? r2 : 2 * k * std::sqrt(r2) - k * k;
}

struct Prior {
  double drag = 0.0, sigma_drag = 0.0;
};

struct Problem {
  std::span<const TimedRay> rays;
  const std::vector<bool>& used;
  double noise_scale;
  Prior prior;
};

double cost(const Problem& problem, const Unknowns& x) {
  const std::vector<double> r2 = squared_residuals(problem.rays, x);
  double sum = 0.0;
  for (std::size_t i = 0; i < r2.size(); ++i)
    if (problem.used[i]) sum += huber_cost(r2[i] / (problem.noise_scale * problem.noise_scale));
  if (x.drags) sum += std::pow((x.drag - problem.prior.drag) / problem.prior.sigma_drag, 2);
  return sum;
}

struct Normal {
  Eigen::MatrixXd information;
  Eigen::VectorXd gradient;
};

/// Normal equations about x, robust weights or (for the covariance) all ones.
Normal normal_equations(const Problem& problem, const Unknowns& x, bool robust) {
  const int n = x.count();
  Normal out{Eigen::MatrixXd::Zero(n, n), Eigen::VectorXd::Zero(n)};
  const std::vector<Where> where = march(problem.rays, x);
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
  return out;
}

Unknowns stepped(const Unknowns& x, const Eigen::VectorXd& d) {
  Unknowns out = x;
  out.ball.position_m += d.head<3>();
  out.ball.velocity_mps += d.segment<3>(3);
  if (x.tilts) {
    const double g = x.gravity.norm();
    out.gravity = g * (x.gravity / g + tangents(x.gravity) * d.segment<2>(6)).normalized();
  }
  if (x.drags) out.drag = std::clamp(x.drag + d[d.size() - 1], 0.0, 1.0);
  return out;
}

/// Levenberg-Marquardt on the Huber cost. False where it ran away.
bool descend(const Problem& problem, Unknowns& x) {
  double best = cost(problem, x), damping = 1e-6;
  for (int i = 0; i < max_steps && std::isfinite(best); ++i) {
    const Normal normal = normal_equations(problem, x, true);
    bool better = false;
    double gain = 0.0;
    while (!better && damping < 1e6) {
      Eigen::MatrixXd damped = normal.information;
      damped.diagonal() *= 1.0 + damping;
      const Unknowns next = stepped(x, -damped.ldlt().solve(normal.gradient));
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

/// Smallest right singular vector of the stacked x_i x (P + V t + a t^2 / 2) = 0, scaled to |a| =
/// g. Rows may be picked; time is scaled to +-1 over the span.
std::optional<Unknowns> closed_form(std::span<const TimedRay> rays,
                                    std::span<const std::size_t> picked, double gravity_mps2) {
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
  return Unknowns{{v.head<3>(), v.segment<3>(3)}, v.tail<3>()};
}

/// With gravity known the same equations are linear in (P, V).
std::optional<Unknowns> linear_form(std::span<const TimedRay> rays,
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
  Unknowns out{{v.head<3>(), v.tail<3>()}, gravity};
  out.tilts = false;
  return out;
}

/// Deterministic subsets: one ray from each of 12 equal parts of the track, another one each time.
std::vector<std::size_t> spread_subset(std::size_t count, std::size_t turn) {
  constexpr std::size_t parts = 12;
  std::vector<std::size_t> out;
  for (std::size_t s = 0; s < parts; ++s) {
    const std::size_t low = s * count / parts, high = (s + 1) * count / parts;
    const auto mixed = static_cast<std::uint32_t>(turn * parts + s + 1) * 2654435761u;  // Knuth
    if (high > low) out.push_back(low + (mixed >> 16) % (high - low));
  }
  return out;
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

class Fit {
 public:
  Fit(std::span<const TimedRay> rays, const FlightFitSettings& settings)
      : rays_(rays), settings_(settings), used_(rays.size(), true) {}

  std::optional<CameraFlight> run() {
    std::vector<std::size_t> all(rays_.size());
    for (std::size_t i = 0; i < all.size(); ++i) all[i] = i;
    std::optional<Unknowns> x = start_from(all);
    if (x && !solve(*x)) x.reset();
    if (settings_.search_outliers && (!x || is_spoilt(*x))) x = search(x);
    if (!x || !reject(*x)) return std::nullopt;
    return result(*x);
  }

 private:
  std::optional<Unknowns> start_from(std::span<const std::size_t> picked) const {
    auto x = settings_.gravity_cam_mps2 ? linear_form(rays_, picked, *settings_.gravity_cam_mps2)
                                        : closed_form(rays_, picked, settings_.gravity_mps2);
    if (!x) return x;
    x->drag = settings_.drag_per_m;
    x->drags = settings_.sigma_drag_per_m > 0;
    return x;
  }

  Problem problem() const {
    return {rays_, used_, scale_, {settings_.drag_per_m, settings_.sigma_drag_per_m}};
  }

  bool solve(Unknowns& x) const { return descend(problem(), x); }

  double limit() const { return std::pow(settings_.outlier_sigmas * scale_, 2); }

  void measure_scale(const Unknowns& x) {
    if (settings_.noise_known) return;
    scale_ =
        std::clamp(std::sqrt(median(squared_residuals(rays_, x)) / median_chi2_2dof), 1e-6, 1e6);
  }

  bool is_spoilt(const Unknowns& x) {
    measure_scale(x);
    const std::vector<double> r2 = squared_residuals(rays_, x);
    return std::any_of(r2.begin(), r2.end(), [&](double r) { return r > limit(); });
  }

  /// Gross outliers ruin the closed form; of four dozen small subsets, at least one holds none. The
  /// one with the least median residual is the start.
  std::optional<Unknowns> search(const std::optional<Unknowns>& first) {
    std::optional<Unknowns> best = first;
    double lowest = best ? median(squared_residuals(rays_, *best)) : 1e300;
    for (std::size_t turn = 0; turn < 48; ++turn) {
      const auto x = start_from(spread_subset(rays_.size(), turn));
      if (!x) continue;
      const double m = median(squared_residuals(rays_, *x));
      if (m >= lowest) continue;
      lowest = m;
      best = x;
    }
    if (!best) return best;
    measure_scale(*best);
    return solve(*best) ? best : std::nullopt;
  }

  /// Drops what lies too far off and fits again until nothing changes. False: too little is left.
  bool reject(Unknowns& x) {
    for (int round = 0; round < 4; ++round) {
      measure_scale(x);
      const std::vector<double> r2 = squared_residuals(rays_, x);
      std::vector<bool> keep(rays_.size());
      // The first cut after a rough start is wide, so that the start's own error drops nothing.
      const double cut = round == 0 ? 25.0 * limit() : limit();
      for (std::size_t i = 0; i < keep.size(); ++i) keep[i] = r2[i] <= cut;
      if (round > 1 && keep == used_) return true;
      used_ = keep;
      if (2 * std::count(used_.begin(), used_.end(), true) < x.count() + 2) return false;
      if (!solve(x)) return false;
    }
    return true;
  }

  std::optional<CameraFlight> result(const Unknowns& x) const {
    const std::vector<double> r2 = squared_residuals(rays_, x);
    CameraFlight out{.position_cam_m = x.ball.position_m,
                     .velocity_cam_mps = x.ball.velocity_mps,
                     .gravity_cam_mps2 = x.gravity,
                     .drag_per_m = x.drag,
                     .covariance = {},
                     .noise_scale = scale_,
                     .used = used_};
    bool any = false;
    for (std::size_t i = 0; i < r2.size(); ++i) {
      if (!used_[i]) continue;
      out.chi2 += r2[i];
      out.dof += 2;
      out.first_s = any ? std::min(out.first_s, rays_[i].time_s) : rays_[i].time_s;
      out.last_s = any ? std::max(out.last_s, rays_[i].time_s) : rays_[i].time_s;
      any = true;
    }
    out.dof -= x.count() - (x.drags ? 1 : 0);
    if (!std::isfinite(out.chi2) || !set_covariance(x, out)) return std::nullopt;
    return out;
  }

  bool set_covariance(const Unknowns& x, CameraFlight& out) const {
    const Eigen::MatrixXd H = normal_equations(problem(), x, false).information;
    const Eigen::VectorXd size = H.diagonal().cwiseSqrt();
    if (!(size.minCoeff() > 0)) return false;
    const Eigen::MatrixXd unit =
        size.cwiseInverse().asDiagonal() * H * size.cwiseInverse().asDiagonal();
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(unit);
    if (eigen.info() != Eigen::Success || !(eigen.eigenvalues()[0] > 1e-13)) return false;
    Eigen::MatrixXd to_all = Eigen::MatrixXd::Zero(10, x.count());
    to_all.topLeftCorner<6, 6>().setIdentity();
    if (x.tilts) to_all.block<3, 2>(6, 6) = x.gravity.norm() * tangents(x.gravity);
    if (x.drags) to_all(9, x.count() - 1) = 1.0;
    const Eigen::MatrixXd root = to_all * size.cwiseInverse().asDiagonal() * eigen.eigenvectors() *
                                 eigen.eigenvalues().cwiseSqrt().cwiseInverse().asDiagonal();
    out.covariance = root * root.transpose();
    const double range = out.position_cam_m.norm();
    const Eigen::Vector3d ray = out.position_cam_m / range;
    const double sigma_depth = std::sqrt(ray.dot(out.covariance.topLeftCorner<3, 3>() * ray));
    return out.covariance.allFinite() && sigma_depth < settings_.max_relative_sigma_depth * range;
  }

  std::span<const TimedRay> rays_;
  const FlightFitSettings& settings_;
  std::vector<bool> used_;
  double scale_ = 1.0;
};

}  // namespace

std::optional<TimedRay> timed_ray(const CameraModel& model, const BallSighting& sighting,
                                  HostTime epoch) {
  const auto ray = model.unproject(sighting.center_px);
  Eigen::Matrix<double, 2, 3> J;
  if (!ray || !model.project(*ray, &J)) return std::nullopt;
  const Eigen::LLT<Eigen::Matrix2d> root(sighting.cov_px2);
  if (root.info() != Eigen::Success || !sighting.cov_px2.allFinite()) return std::nullopt;
  return TimedRay{seconds(sighting.time - epoch) + model.row_time_s * sighting.center_px.y(), *ray,
                  root.matrixL().solve(J)};
}

BallState CameraFlight::at(double time_s) const {
  return fly({position_cam_m, velocity_cam_mps}, time_s, gravity_cam_mps2, drag_per_m);
}

Eigen::Matrix<double, 6, 6> CameraFlight::covariance_at(double time_s) const {
  const Propagation p =
      propagate({position_cam_m, velocity_cam_mps}, time_s, gravity_cam_mps2, drag_per_m);
  Eigen::Matrix<double, 6, 10> F = Eigen::Matrix<double, 6, 10>::Zero();
  F.topLeftCorner<3, 3>().setIdentity();
  F.block<3, 3>(0, 3) = p.J_position_velocity0;
  F.block<3, 3>(3, 3) = p.J_velocity_velocity0;
  F.block<3, 3>(0, 6) = 0.5 * time_s * time_s * Eigen::Matrix3d::Identity();
  F.block<3, 3>(3, 6) = time_s * Eigen::Matrix3d::Identity();
  F.block<3, 1>(0, 9) = p.J_position_drag;
  F.block<3, 1>(3, 9) = p.J_velocity_drag;
  return F * covariance * F.transpose();
}

std::optional<CameraFlight> fit_flight(CameraId camera, HostTime epoch,
                                       std::span<const TimedRay> rays,
                                       const FlightFitSettings& settings) {
  if (rays.size() < 5) return std::nullopt;
  const HostTime middle = epoch + from_seconds(0.5 * (rays.front().time_s + rays.back().time_s));
  std::vector<TimedRay> shifted(rays.begin(), rays.end());
  for (TimedRay& ray : shifted) ray.time_s -= seconds(middle - epoch);
  auto flight = Fit(shifted, settings).run();
  if (!flight) return flight;
  flight->camera = camera;
  flight->epoch = middle;
  return flight;
}

std::optional<CameraFlight> fit_flight(const CameraModel& model,
                                       std::span<const BallSighting> sightings,
                                       const FlightFitSettings& settings) {
  if (sightings.empty()) return std::nullopt;
  const HostTime epoch = sightings.front().time;
  std::vector<TimedRay> rays;
  std::vector<std::size_t> origin;
  for (std::size_t i = 0; i < sightings.size(); ++i) {
    const auto ray = timed_ray(model, sightings[i], epoch);
    if (!ray) continue;
    rays.push_back(*ray);
    origin.push_back(i);
  }
  auto flight = fit_flight(sightings.front().camera, epoch, rays, settings);
  if (!flight) return flight;
  std::vector<bool> used(sightings.size(), false);
  for (std::size_t i = 0; i < origin.size(); ++i) used[origin[i]] = flight->used[i];
  flight->used = std::move(used);
  return flight;
}

std::optional<Eigen::Vector3d> mean_gravity(std::span<const CameraFlight> flights) {
  const double near = std::cos(10.0 * std::numbers::pi / 180.0);
  std::optional<Eigen::Vector3d> best;
  double heaviest = 0.0;
  for (const CameraFlight& centre : flights) {
    Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    double weight = 0.0;
    for (const CameraFlight& f : flights) {
      const Eigen::Vector3d a = f.gravity_cam_mps2.normalized();
      if (a.dot(centre.gravity_cam_mps2.normalized()) < near) continue;
      // A floor of 0.05 degrees: no single fit is trusted to outweigh all others without end.
      const double g = f.gravity_cam_mps2.norm(), floor = std::pow(1e-3 * g, 2);
      const Eigen::Matrix3d W =
          (f.covariance.block<3, 3>(6, 6) + floor * Eigen::Matrix3d::Identity()).inverse();
      information += W;
      sum += W * f.gravity_cam_mps2;
      weight += 1.0 / (f.covariance.block<3, 3>(6, 6).trace() + floor);
    }
    if (weight <= heaviest) continue;
    heaviest = weight;
    best = centre.gravity_cam_mps2.norm() * (information.inverse() * sum).normalized();
  }
  return best;
}

std::vector<std::optional<CameraFlight>> fit_flights(const CameraModel& model,
                                                     std::span<const Track> tracks,
                                                     const FlightFitSettings& settings) {
  std::vector<CameraFlight> alone;
  for (const Track& track : tracks)
    if (auto flight = fit_flight(model, track.sightings, settings))
      alone.push_back(*std::move(flight));
  FlightFitSettings levelled = settings;
  if (!levelled.gravity_cam_mps2) levelled.gravity_cam_mps2 = mean_gravity(alone);
  std::vector<std::optional<CameraFlight>> out;
  for (const Track& track : tracks) out.push_back(fit_flight(model, track.sightings, levelled));
  return out;
}

}  // namespace throwcal
