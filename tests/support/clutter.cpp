// SPDX-License-Identifier: BSD-3-Clause
#include "tests/support/clutter.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "estimator/ballistics.h"

namespace throwcal::test {
namespace {

constexpr double hand_s = 0.5, bounce_s = 0.5, restitution = 0.7;

struct Draw {
  std::mt19937_64 engine;
  double uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(engine);
  }
  double normal(double sigma) { return std::normal_distribution<double>(0.0, 1.0)(engine) * sigma; }
};

class Recorder {
 public:
  Recorder(const Thrown& scene, const ThrowerSettings& settings, CameraId camera,
           const ClutterSettings& clutter)
      : scene_(scene),
        settings_(settings),
        clutter_(clutter),
        camera_(camera),
        draw_{std::mt19937_64(clutter.seed * 1000003 + camera)} {}

  Stream record() {
    const double end_s = seconds(scene_.flights.back().start.time_since_epoch()) + 2.5;
    const double phase_s = scene_.rig.estimate_offsets ? 0.3 / settings_.frames_per_s : 0.0;
    const Eigen::Vector2d spot(draw_.uniform(100, 1100), draw_.uniform(100, 600));
    for (int n = 0; n / settings_.frames_per_s < end_s; ++n) {
      const double true_s = n / settings_.frames_per_s + phase_s;
      frame_ = {camera_, HostTime(from_seconds(true_s - scene_.time_offset_s[camera_])), {}};
      for (std::size_t j = 0; j < scene_.flights.size(); ++j) add_ball(j, true_s);
      if (clutter_.walker) see(head(true_s), 0.11, "clutter");
      if (clutter_.spots) add_spots(spot);
      std::shuffle(frame_.sightings.begin(), frame_.sightings.end(), draw_.engine);
      out_.frames.push_back(frame_);
    }
    return std::move(out_);
  }

 private:
  void add_ball(std::size_t j, double true_s) {
    const Flight& f = scene_.flights[j];
    const double t = true_s - seconds(f.start.time_since_epoch());
    const double flown_s = settings_.duration_s;
    const Eigen::Vector3d gravity(0, 0, -scene_.rig.gravity_mps2);
    const BallState start{f.position_world_m, f.velocity_world_mps};
    const std::string& name = scene_.throws[j].id;
    if (draw_.uniform(0, 1) < clutter_.miss) return;
    if (t >= -hand_s && t < 0 && clutter_.hand) {
      // Speeds up smoothly from rest and lets go with the flight's position and velocity.
      const double tau = t / hand_s;
      const double along =
          hand_s * (tau / 2 + std::sin(std::numbers::pi * tau) / (2 * std::numbers::pi));
      see(f.position_world_m + along * f.velocity_world_mps, 0.0, "hand");
    } else if (t >= 0 && t < flown_s) {
      see(fly(start, t, gravity, f.drag_per_m).position_m, 0.0, name);
    } else if (t >= flown_s && t < flown_s + bounce_s && clutter_.bounce) {
      BallState up = fly(start, flown_s, gravity, f.drag_per_m);
      up.velocity_mps.z() *= -restitution;
      see(fly(up, t - flown_s, gravity, f.drag_per_m).position_m, 0.0, name + "b");
    }
  }

  Eigen::Vector3d head(double true_s) const {
    const double along_m = std::fmod(1.1 * true_s, 5.5) - 2.7;
    return {4.2 + 0.04 * std::sin(6.0 * true_s), along_m, 0.5 + 0.03 * std::sin(12.0 * true_s)};
  }

  void add_spots(const Eigen::Vector2d& spot) {
    if (draw_.uniform(0, 1) < 0.3)
      blob(spot + Eigen::Vector2d(draw_.normal(0.4), draw_.normal(0.4)), 6.0, "clutter");
    if (draw_.uniform(0, 1) < 0.15)
      blob({draw_.uniform(0, 1279), draw_.uniform(0, 719)}, draw_.uniform(2, 12), "clutter");
  }

  /// A sphere of a radius [m], 0: the ball.
  void see(const Eigen::Vector3d& world, double radius_m, const std::string& what) {
    const CameraModel& model = scene_.rig.cameras[camera_].model;
    const Eigen::Vector3d in_camera = scene_.T_world_cam[camera_].inverse() * world;
    const auto pixel = model.project(in_camera);
    if (!pixel || !model.contains(*pixel, 1.0)) return;
    const double r = radius_m > 0 ? radius_m : 0.5 * scene_.rig.ball.diameter_m;
    const double sigma = settings_.sigma_px;
    blob(*pixel + Eigen::Vector2d(draw_.normal(sigma), draw_.normal(sigma)),
         model.fx_px * r / in_camera.norm() * (1 + draw_.normal(0.04)), what);
  }

  void blob(const Eigen::Vector2d& pixel, double radius_px, const std::string& what) {
    const double stated = settings_.state_sigma ? settings_.sigma_px : 1.0;
    frame_.sightings.push_back({camera_, frame_.time, pixel,
                                stated * stated * Eigen::Matrix2d::Identity(),
                                clutter_.radius ? std::optional(radius_px) : std::nullopt, id_});
    out_.truth[id_++] = what;
  }

  const Thrown& scene_;
  const ThrowerSettings& settings_;
  const ClutterSettings& clutter_;
  CameraId camera_;
  Draw draw_;
  Stream out_;
  FrameSightings frame_;
  std::uint64_t id_ = 0;
};

}  // namespace

Stream make_stream(const Thrown& scene, const ThrowerSettings& settings, CameraId camera,
                   const ClutterSettings& clutter) {
  Stream out = Recorder(scene, settings, camera, clutter).record();
  return out;
}

}  // namespace throwcal::test
