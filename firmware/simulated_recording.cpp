// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/simulated_recording.h"

#include <algorithm>
#include <cmath>
#include <random>

namespace throwcal {
namespace {

constexpr double hand_radius_m = 0.05;
constexpr double clutter_per_frame = 0.02;
constexpr double radius_noise = 0.04;  // relative

/// One camera's frames, one after the other.
class SimulatedWatcher {
 public:
  SimulatedWatcher(const SimulatedScene& scene, CameraId camera,
                   const SimulatedRecordingSettings& settings)
      : scene_(scene),
        settings_(settings),
        camera_(camera),
        model_(scene.rig().cameras.at(camera).model),
        T_cam_world_(scene.T_world_cam(camera).inverse()),
        dice_(scene.settings().seed * 1000003 + camera) {}

  void watch(double end_s, std::vector<SightingRow>& rows) {
    for (int k = 0; row0_s(k) <= end_s; ++k) {
      see_ball(row0_s(k), rows);
      if (!settings_.labelled) see_the_rest(row0_s(k), rows);
    }
  }

  /// Where the ball is in each frame, without noise.
  Json true_frames(double end_s) const {
    Json out = Json::array();
    for (int k = 0; row0_s(k) < end_s; ++k) {
      const auto ball = scene_.ball_at(row0_s(k));
      const auto pixel = ball ? pixel_of_ball(row0_s(k)) : std::nullopt;
      if (!pixel) continue;
      const double radius_px =
          apparent_radius_px(ball->position_world_m, 0.5 * scene_.rig().ball.diameter_m);
      const std::string flight =
          std::to_string(ball->throw_number + 1) + (ball->after_bounce ? "b" : "");
      out.push_back({{"frame", k},
                     {"time_s", row0_s(k) - scene_.time_offset_s(camera_)},
                     {"u_px", pixel->x()},
                     {"v_px", pixel->y()},
                     {"radius_px", radius_px},
                     {"is", ball->in_hand ? "hand" : flight},
                     {"fully_inside", model_.contains(*pixel, radius_px)}});
    }
    return out;
  }

 private:
  using Place = std::optional<Eigen::Vector3d>;

  double row0_s(int frame) const {
    return scene_.frame_phase_s(camera_) + frame / scene_.settings().frames_per_s;
  }

  /// Pixel of what moves like `place` at the moment its row is exposed: row0 + row_time *
  /// v(moment), by fixed-point iteration (the picture moves far slower than the shutter rolls).
  template <typename PlaceAt>
  std::optional<Eigen::Vector2d> pixel_of(double row0_s, const PlaceAt& place) const {
    std::optional<Eigen::Vector2d> pixel;
    double moment_s = row0_s;
    for (int i = 0; i < (model_.row_time_s > 0.0 ? 6 : 1); ++i) {
      const Place at = place(moment_s);
      pixel = at ? model_.project(T_cam_world_ * *at) : std::nullopt;
      if (!pixel || !model_.contains(*pixel)) return {};
      moment_s = row0_s + model_.row_time_s * pixel->y();
    }
    return pixel;
  }

  std::optional<Eigen::Vector2d> pixel_of_ball(double row0_s) const {
    return pixel_of(row0_s, [&](double time_s) {
      const auto then = scene_.ball_at(time_s);
      return then ? Place(then->position_world_m) : Place();
    });
  }

  void see_ball(double row0_s, std::vector<SightingRow>& rows) {
    const auto ball = scene_.ball_at(row0_s);
    if (!ball) return;
    const bool in_flight = !ball->in_hand && !ball->after_bounce;
    if (settings_.labelled && !in_flight) return;
    const auto pixel = pixel_of_ball(row0_s);
    if (!pixel) return;
    const double radius_m = 0.5 * scene_.rig().ball.diameter_m;
    add(row0_s, *pixel, apparent_radius_px(ball->position_world_m, radius_m), rows);
    if (settings_.labelled) rows.back().throw_id = std::to_string(ball->throw_number + 1);
  }

  void see_the_rest(double row0_s, std::vector<SightingRow>& rows) {
    if (const auto hand = scene_.hand_at(row0_s))
      if (const auto pixel = pixel_of(row0_s, [&](double t) { return scene_.hand_at(t); }))
        add(row0_s, *pixel, apparent_radius_px(*hand, hand_radius_m), rows);
    if (uniform(0, 1) < clutter_per_frame)
      add(row0_s, {uniform(0, model_.width_px - 1), uniform(0, model_.height_px - 1)},
          uniform(1.5, 8), rows);
  }

  double apparent_radius_px(const Eigen::Vector3d& at_world_m, double radius_m) const {
    return model_.fx_px * radius_m / (T_cam_world_ * at_world_m).norm();
  }

  void add(double row0_s, const Eigen::Vector2d& pixel, double radius_px,
           std::vector<SightingRow>& rows) {
    BallSighting s;
    s.camera = camera_;
    s.time = HostTime(from_seconds(row0_s - scene_.time_offset_s(camera_)));
    s.center_px = pixel + Eigen::Vector2d(normal(settings_.sigma_px), normal(settings_.sigma_px));
    s.cov_px2 *= settings_.sigma_px * settings_.sigma_px;
    s.radius_px = radius_px * (1.0 + normal(radius_noise));
    rows.push_back({s, {}});
  }

  double uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(dice_);
  }
  double normal(double sigma) { return sigma * std::normal_distribution<double>()(dice_); }

  const SimulatedScene& scene_;
  const SimulatedRecordingSettings& settings_;
  const CameraId camera_;
  const CameraModel model_;
  const Rigid T_cam_world_;
  std::mt19937_64 dice_;
};

Json vector(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

}  // namespace

double end_of_recording_s(const SimulatedScene& scene, int throws) {
  double end_s = 0.0;
  const double horizon_s = (throws + 2) * scene.settings().throw_interval_s + 10.0;
  for (const auto& arc : scene.arc_list(0.0, horizon_s))
    if (arc.number < throws) end_s = std::max(end_s, arc.end_s);
  return end_s;
}

std::vector<SightingRow> simulated_sightings(const SimulatedScene& scene,
                                             const SimulatedRecordingSettings& settings) {
  std::vector<SightingRow> rows;
  const double end_s = end_of_recording_s(scene, settings.throws);
  for (CameraId id = 0; id < scene.rig().cameras.size(); ++id)
    SimulatedWatcher(scene, id, settings).watch(end_s, rows);
  std::ranges::stable_sort(rows, {}, [](const SightingRow& row) { return row.sighting.time; });
  for (std::size_t i = 0; i < rows.size(); ++i) rows[i].sighting.id = i + 1;
  return rows;
}

Json truth_document(const SimulatedScene& scene, int throws) {
  Json cameras = Json::array(), arcs = Json::array();
  for (CameraId id = 0; id < scene.rig().cameras.size(); ++id)
    cameras.push_back({{"name", scene.rig().cameras[id].name},
                       {"T_world_cam", pose_to_json(scene.T_world_cam(id))},
                       {"time_offset_s", scene.time_offset_s(id)}});
  for (const auto& arc : scene.arc_list(0.0, end_of_recording_s(scene, throws)))
    if (arc.number < throws)
      arcs.push_back({{"id", std::to_string(arc.number + 1)},
                      {"start_s", arc.start_s},
                      {"end_s", arc.end_s},
                      {"position_m", vector(arc.position_world_m)},
                      {"velocity_mps", vector(arc.velocity_world_mps)},
                      {"main", !arc.after_bounce}});
  return {{"cameras", std::move(cameras)},
          {"throws", std::move(arcs)},
          {"drag_per_m", scene.settings().drag_per_m},
          {"gravity_mps2", scene.rig().gravity_mps2}};
}

Json true_frames(const SimulatedScene& scene, double end_s) {
  Json out = Json::object();
  for (CameraId id = 0; id < scene.rig().cameras.size(); ++id)
    out[scene.rig().cameras[id].name] = SimulatedWatcher(scene, id, {}).true_frames(end_s);
  return out;
}

}  // namespace throwcal
