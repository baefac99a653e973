// SPDX-License-Identifier: BSD-3-Clause
#include "tests/support/thrower.h"

#include <cmath>
#include <numbers>
#include <random>

#include "estimator/ballistics.h"

namespace throwcal::test {
namespace {

constexpr double pi = std::numbers::pi;

struct Draw {
  std::mt19937_64 engine;
  double uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(engine);
  }
  double normal(double sigma) { return std::normal_distribution<double>(0.0, 1.0)(engine) * sigma; }
};

void add_cameras(Thrown& out, const ThrowerSettings& s, Draw& draw) {
  const double radius = s.side_m / std::sqrt(2.0);
  for (int k = 0; k < s.cameras; ++k) {
    const double angle = s.arc_rad * k / s.cameras - 0.75 * pi;
    const Eigen::Vector3d centre(radius * std::cos(angle), radius * std::sin(angle),
                                 1.2 + draw.uniform(-0.1, 0.1));
    const Eigen::Vector3d target(draw.uniform(-0.2, 0.2), draw.uniform(-0.2, 0.2),
                                 1.5 + draw.uniform(-0.2, 0.2));
    out.T_world_cam.push_back(look_at(centre, target, draw.uniform(-0.05, 0.05)));
    CameraModel model = s.model;
    model.row_time_s = s.row_time_s;
    out.rig.cameras.push_back({"cam" + std::to_string(k + 1), model,
                               s.state_sigma ? std::optional(s.sigma_px) : std::nullopt});
    out.true_models.push_back(model);
    out.time_offset_s.push_back(k ? draw.uniform(-s.max_offset_s, s.max_offset_s) : 0.0);
  }
}

void move_to_world(Thrown& out, std::vector<BallState>& starts) {
  const Eigen::Vector3d forward = out.T_world_cam[0].rotation.col(2);
  Rigid T_world_site{exp_so3({0, 0, -std::atan2(forward.y(), forward.x())}),
                     Eigen::Vector3d::Zero()};
  T_world_site.translation = -(T_world_site.rotation * out.T_world_cam[0].translation);
  for (Rigid& pose : out.T_world_cam) pose = T_world_site * pose;
  for (BallState& start : starts)
    start = {T_world_site * start.position_m, T_world_site.rotation * start.velocity_mps};
}

/// The moment a rolling shutter sees the ball: row0 + row_time * v(moment), by fixed-point
/// iteration.
std::optional<Eigen::Vector2d> see(const Thrown& out, std::size_t k, const BallState& start,
                                   double row0_s, double drag) {
  const CameraModel& model = out.rig.cameras[k].model;
  double moment = row0_s;
  std::optional<Eigen::Vector2d> pixel;
  for (int i = 0; i < 12; ++i) {
    const BallState ball = fly(start, moment, {0, 0, -out.rig.gravity_mps2}, drag);
    pixel = model.project(out.T_world_cam[k].inverse() * ball.position_m);
    if (!pixel) return std::nullopt;
    moment = row0_s + model.row_time_s * pixel->y();
  }
  return pixel;
}

}  // namespace

Thrown make_thrown(const ThrowerSettings& s) {
  Thrown out;
  Draw draw{std::mt19937_64(s.seed)};
  add_cameras(out, s, draw);
  std::vector<BallState> starts;
  for (int j = 0; j < s.throws; ++j) {
    const double angle = draw.uniform(0, 2 * pi),
                 speed = s.vertical_drops ? 0.0 : draw.uniform(0.6, 2.0);
    const double up = s.vertical_drops ? 0.0 : draw.uniform(3.2, 4.4);
    const Eigen::Vector3d from =
        s.vertical_drops ? Eigen::Vector3d(0.2, -0.1, draw.uniform(2.4, 2.9))
                         : Eigen::Vector3d(draw.uniform(-1, 1), draw.uniform(-1, 1), 1.2);
    starts.push_back({from, {speed * std::cos(angle), speed * std::sin(angle), up}});
  }
  move_to_world(out, starts);
  out.rig.ball.estimate_drag = s.estimate_drag;
  out.rig.ball.drag_per_m = s.estimate_drag ? 0.0 : s.drag_per_m;
  out.rig.estimate_offsets = s.max_offset_s > 0;
  std::vector<double> phase(out.rig.cameras.size(), 0.0);
  if (s.max_offset_s > 0)
    for (double& p : phase) p = draw.uniform(0, 1 / s.frames_per_s);

  std::uint64_t id = 0;
  for (std::size_t j = 0; j < starts.size(); ++j) {
    const double start_s = 1.0 + 2.0 * static_cast<double>(j);
    out.flights.push_back({HostTime(from_seconds(start_s)), starts[j].position_m,
                           starts[j].velocity_mps, s.drag_per_m});
    Throw thrown{std::to_string(j + 1), {}};
    for (std::size_t k = 0; k < out.rig.cameras.size(); ++k) {
      Track track{static_cast<CameraId>(k), {}};
      const auto first = std::ceil((start_s - phase[k]) * s.frames_per_s);
      for (double n = first; n / s.frames_per_s + phase[k] < start_s + s.duration_s; ++n) {
        const double true_s = n / s.frames_per_s + phase[k];
        const auto pixel = see(out, k, starts[j], true_s - start_s, s.drag_per_m);
        if (!pixel || !out.rig.cameras[k].model.contains(*pixel, 1.0)) continue;
        Eigen::Vector2d measured =
            *pixel + Eigen::Vector2d(draw.normal(s.sigma_px), draw.normal(s.sigma_px));
        if (draw.uniform(0, 1) < s.outlier_fraction)
          measured = {draw.uniform(0, s.model.width_px - 1),
                      draw.uniform(0, s.model.height_px - 1)};
        track.sightings.push_back(
            {static_cast<CameraId>(k), HostTime(from_seconds(true_s - out.time_offset_s[k])),
             measured, s.sigma_px * s.sigma_px * Eigen::Matrix2d::Identity(), std::nullopt, id++});
      }
      if (!track.sightings.empty()) thrown.tracks.push_back(std::move(track));
    }
    out.throws.push_back(std::move(thrown));
  }
  return out;
}

}  // namespace throwcal::test
