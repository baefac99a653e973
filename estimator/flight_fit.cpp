// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/flight_fit.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>

#include "estimator/elementary.h"
#include "estimator/ray_fit.h"

namespace throwcal {
namespace {

constexpr double median_chi2_2dof = 1.3862944;  // of two unit normals' squared sum

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
    std::optional<FlightUnknowns> x = start_from(all);
    if (x && !solve(*x)) x.reset();
    if (settings_.search_outliers && (!x || is_spoilt(*x))) x = search(x);
    if (!x || (is_spoilt(*x) && !reject(*x))) return std::nullopt;
    return result(*x);
  }

 private:
  std::optional<FlightUnknowns> start_from(std::span<const std::size_t> picked) const {
    auto x = settings_.gravity_cam_mps2 ? linear_form(rays_, picked, *settings_.gravity_cam_mps2)
                                        : closed_form(rays_, picked, settings_.gravity_mps2);
    if (!x) return x;
    x->tilts = !settings_.gravity_cam_mps2 || settings_.sigma_gravity_rad > 0;
    x->drag = settings_.drag_per_m;
    x->drags = settings_.sigma_drag_per_m > 0;
    return x;
  }

  RayProblem problem() const {
    return {rays_,
            used_,
            scale_,
            {settings_.drag_per_m, settings_.sigma_drag_per_m,
             settings_.gravity_cam_mps2.value_or(Eigen::Vector3d::Zero()),
             settings_.sigma_gravity_rad}};
  }

  bool solve(FlightUnknowns& x) const { return descend(problem(), x); }

  double limit() const { return square(settings_.outlier_sigmas * scale_); }

  void measure_scale(const FlightUnknowns& x) {
    if (settings_.noise_known) return;
    scale_ =
        std::clamp(std::sqrt(median(squared_residuals(rays_, x)) / median_chi2_2dof), 1e-6, 1e6);
  }

  bool is_spoilt(const FlightUnknowns& x) {
    measure_scale(x);
    const std::vector<double> r2 = squared_residuals(rays_, x);
    return std::any_of(r2.begin(), r2.end(), [&](double r) { return r > limit(); });
  }

  /// Gross outliers ruin the closed form; of four dozen small subsets, at least one holds none. The
  /// one with the least median residual is the start.
  std::optional<FlightUnknowns> search(const std::optional<FlightUnknowns>& first) {
    std::optional<FlightUnknowns> best = first;
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
  bool reject(FlightUnknowns& x) {
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

  std::optional<CameraFlight> result(const FlightUnknowns& x) const {
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
    const int with_prior = (x.drags ? 1 : 0) + (x.tilts && settings_.sigma_gravity_rad > 0 ? 2 : 0);
    out.dof -= x.count() - with_prior;
    if (!std::isfinite(out.chi2) || !set_covariance(x, out)) return std::nullopt;
    return out;
  }

  bool set_covariance(const FlightUnknowns& x, CameraFlight& out) const {
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
  Propagation p{{},
                time_s * Eigen::Matrix3d::Identity(),
                Eigen::Matrix3d::Identity(),
                Eigen::Vector3d::Zero(),
                Eigen::Vector3d::Zero()};
  if (drag_per_m != 0.0)
    p = propagate({position_cam_m, velocity_cam_mps}, time_s, gravity_cam_mps2, drag_per_m);
  Eigen::Matrix<double, 6, 10> F = Eigen::Matrix<double, 6, 10>::Zero();
  F.topLeftCorner<3, 3>().setIdentity();
  F.block<3, 3>(0, 3) = p.J_position_velocity0;
  F.block<3, 3>(3, 3) = p.J_velocity_velocity0;
  F.block<3, 3>(0, 6) = 0.5 * time_s * time_s * Eigen::Matrix3d::Identity();
  F.block<3, 3>(3, 6) = time_s * Eigen::Matrix3d::Identity();
  F.block<3, 1>(0, 9) = p.J_position_drag;
  F.block<3, 1>(3, 9) = p.J_velocity_drag;
  const Eigen::Matrix<double, 6, 10> FC = F.lazyProduct(covariance);
  return FC.lazyProduct(F.transpose());
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

std::optional<GravityEstimate> estimate_gravity(std::span<const CameraFlight> flights) {
  const double near = elementary::cos(10.0 * std::numbers::pi / 180.0);
  std::optional<GravityEstimate> best;
  double heaviest = 0.0;
  for (const CameraFlight& centre : flights) {
    Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    double weight = 0.0;
    int count = 0;
    for (const CameraFlight& f : flights) {
      const Eigen::Vector3d a = f.gravity_cam_mps2.normalized();
      if (a.dot(centre.gravity_cam_mps2.normalized()) < near) continue;
      // Floors: no single fit is trusted to outweigh the others without end, least of all in the
      // choice of the cluster (a false flight may look very sure of itself).
      const double g = f.gravity_cam_mps2.norm();
      const Eigen::Matrix3d cov = f.covariance.block<3, 3>(6, 6);
      const Eigen::Matrix3d W = (cov + square(1e-3 * g) * Eigen::Matrix3d::Identity()).inverse();
      information += W;
      sum += W * f.gravity_cam_mps2;
      weight += 1.0 / (cov.trace() + square(2e-2 * g));
      ++count;
    }
    if (weight <= heaviest) continue;
    heaviest = weight;
    const double g = centre.gravity_cam_mps2.norm();
    const Eigen::Matrix3d cov = information.inverse();
    const Eigen::Vector3d down = (cov * sum).normalized();
    const double across = cov.trace() - down.dot(cov * down);
    best = GravityEstimate{g * down, std::sqrt(0.5 * std::max(across, 0.0)) / g, count};
  }
  return best;
}

std::optional<Eigen::Vector3d> mean_gravity(std::span<const CameraFlight> flights) {
  const auto estimate = estimate_gravity(flights);
  return estimate ? std::optional(estimate->gravity_cam_mps2) : std::nullopt;
}

}  // namespace throwcal
