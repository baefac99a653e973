// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/bootstrap.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <utility>

#include "estimator/elementary.h"
#include "estimator/flight_alignment.h"

namespace throwcal {
namespace {

constexpr double unknown_drag_sigma_per_m =
    0.03;  // of a thrown ball: a tennis ball has 0.018, table tennis 0.12
constexpr double max_offset_s = 0.2;
constexpr std::size_t enough_sightings = 18;
constexpr double gate_chi2 = 200.0;  // the pairs are given, only their fits may be off

FlightFitSettings fit_settings(const RigDescription& rig, const CameraDescription& camera) {
  FlightFitSettings out;
  out.gravity_mps2 = rig.gravity_mps2;
  out.drag_per_m = rig.ball.drag_per_m;
  if (rig.ball.estimate_drag) out.sigma_drag_per_m = unknown_drag_sigma_per_m;
  out.noise_known = camera.sigma_px.has_value();
  return out;
}

/// What a start needs of a track: `enough_sightings` and less than twice as many, spread over all
/// of it, with the noise that the rig states, where it does. The refinement takes them all.
Track thinned(const Track& track, const CameraDescription& camera) {
  const std::size_t stride = std::max<std::size_t>(1, track.sightings.size() / enough_sightings);
  Track out{track.camera, {}};
  for (std::size_t i = 0; i < track.sightings.size(); i += stride) {
    out.sightings.push_back(track.sightings[i]);
    if (camera.sigma_px)
      out.sightings.back().cov_px2 =
          *camera.sigma_px * *camera.sigma_px * Eigen::Matrix2d::Identity();
  }
  return out;
}

/// T_world_cam of camera 1 from gravity in its axes: z up, x along its viewing direction laid
/// level.
std::optional<Rigid> level_pose(const Eigen::Vector3d& gravity_cam) {
  const Eigen::Vector3d up = -gravity_cam.normalized();
  const Eigen::Vector3d ahead = Eigen::Vector3d::UnitZ() - up.z() * up;
  if (ahead.norm() < 1e-3) return std::nullopt;  // straight up or down: no heading
  Eigen::Matrix3d R_world_cam;
  R_world_cam << ahead.normalized().transpose(), up.cross(ahead.normalized()).transpose(),
      up.transpose();
  return Rigid{R_world_cam, Eigen::Vector3d::Zero()};
}

std::size_t count_shared(const FlightTable& flights, std::size_t a, std::size_t b) {
  return static_cast<std::size_t>(std::count_if(
      flights.begin(), flights.end(), [&](const auto& thrown) { return thrown[a] && thrown[b]; }));
}

std::vector<std::pair<CameraFlight, CameraFlight>> shared_flights(const FlightTable& flights,
                                                                  std::size_t a, std::size_t b) {
  std::vector<std::pair<CameraFlight, CameraFlight>> out;
  for (const auto& thrown : flights)
    if (thrown[a] && thrown[b]) out.emplace_back(*thrown[a], *thrown[b]);
  return out;
}

/// A ball in the world from the placed camera that knows it best, at the throw's epoch on camera
/// 1's clock.
std::optional<BallState> best_ball(const TimedThrow& thrown,
                                   const std::vector<std::optional<CameraFlight>>& flights,
                                   const RigState& rig) {
  std::optional<BallState> best;
  double best_variance = 0.0;
  for (std::size_t k = 0; k < flights.size(); ++k) {
    if (!flights[k] || !rig.is_placed[k]) continue;
    const double time_s = seconds(thrown.epoch - flights[k]->epoch) - rig.time_offset_s[k];
    const double variance = flights[k]->covariance_at(time_s).trace();
    if (best && variance >= best_variance) continue;
    const BallState ball = flights[k]->at(time_s);
    best = BallState{rig.T_world_cam[k] * ball.position_m,
                     rig.T_world_cam[k].rotation * ball.velocity_mps};
    best_variance = variance;
  }
  return best;
}

Start with_balls(RigState rig, const std::vector<TimedThrow>& throws, const FlightTable& flights) {
  Start out{std::move(rig), {}};
  for (std::size_t j = 0; j < throws.size(); ++j)
    out.balls.push_back(best_ball(throws[j], flights[j], out.rig));
  return out;
}

/// The pair of a placed and an unplaced camera that shares most flights and can be aligned.
struct Edge {
  std::size_t from = 0, to = 0, shared = 0;
};

/// Places one more camera; false where none can be reached. Pairs that could not be aligned are
/// remembered.
bool place_next(const RigDescription& rig, const FlightTable& flights, RigState& state,
                std::vector<std::vector<char>>& failed) {
  Edge best;
  for (std::size_t a = 0; a < state.cameras(); ++a)
    for (std::size_t b = 0; b < state.cameras(); ++b)
      if (state.is_placed[a] && !state.is_placed[b] && !failed[a][b])
        if (const std::size_t shared = count_shared(flights, a, b); shared > best.shared)
          best = {a, b, shared};
  if (best.shared == 0) return false;
  const auto pairs = shared_flights(flights, best.from, best.to);
  const auto aligned = align_cameras(pairs, {.estimate_offset = rig.estimate_offsets,
                                             .max_offset_s = max_offset_s,
                                             .gate_chi2 = gate_chi2});
  if (!aligned) {
    failed[best.from][best.to] = true;
    return true;
  }
  state.T_world_cam[best.to] = state.T_world_cam[best.from] * aligned->T_a_b;
  state.time_offset_s[best.to] = state.time_offset_s[best.from] + aligned->offset_b_minus_a_s;
  state.is_placed[best.to] = true;
  return true;
}

}  // namespace

FlightTable fit_all_flights(const RigDescription& rig, const std::vector<Throw>& throws,
                            FitMemory& fits) {
  FlightTable out(throws.size(), std::vector<std::optional<CameraFlight>>(rig.cameras.size()));
  for (std::size_t k = 0; k < rig.cameras.size(); ++k) {
    std::vector<Track> tracks(throws.size(), Track{static_cast<CameraId>(k), {}});
    for (std::size_t j = 0; j < throws.size(); ++j)
      for (const Track& track : throws[j].tracks)
        if (track.camera == k) tracks[j] = thinned(track, rig.cameras[k]);
    auto fitted =
        fit_flights(rig.cameras[k].model, tracks, fit_settings(rig, rig.cameras[k]), fits);
    for (std::size_t j = 0; j < throws.size(); ++j) out[j][k] = std::move(fitted[j]);
  }
  return out;
}

std::optional<Start> bootstrap(const RigDescription& rig, const std::vector<TimedThrow>& throws,
                               const FlightTable& flights) {
  const std::size_t cameras = rig.cameras.size();
  std::vector<CameraFlight> of_first;
  for (const auto& thrown : flights)
    if (thrown[0]) of_first.push_back(*thrown[0]);
  const auto gravity = mean_gravity(of_first);
  const auto first = gravity ? level_pose(*gravity) : std::nullopt;
  if (!first) return std::nullopt;

  RigState state = unplaced(rig);
  state.T_world_cam[0] = *first, state.is_placed[0] = true;
  std::vector<std::vector<char>> failed(cameras, std::vector<char>(cameras, 0));
  while (place_next(rig, flights, state, failed)) {
  }
  return with_balls(std::move(state), throws, flights);
}

Start start_from_guess(const RigDescription& rig, const std::vector<TimedThrow>& throws,
                       const FlightTable& flights, const Guess& guess) {
  const std::size_t cameras = rig.cameras.size();
  const Eigen::Vector3d ahead = guess.T_world_cam[0].rotation.col(2);
  Rigid T_world_guess{exp_so3({0, 0, -elementary::atan2(ahead.y(), ahead.x())}),
                      Eigen::Vector3d::Zero()};
  T_world_guess.translation = -(T_world_guess.rotation * guess.T_world_cam[0].translation);
  RigState state = unplaced(rig);
  for (std::size_t k = 0; k < cameras; ++k)
    state.T_world_cam[k] = T_world_guess * guess.T_world_cam[k];
  state.is_placed.assign(cameras, true);
  if (rig.estimate_offsets) state.time_offset_s = guess.time_offset_s;
  if (rig.ball.estimate_drag) state.drag_per_m = guess.drag_per_m;
  return with_balls(std::move(state), throws, flights);
}

}  // namespace throwcal
