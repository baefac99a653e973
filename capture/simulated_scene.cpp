// SPDX-License-Identifier: BSD-3-Clause
#include "capture/simulated_scene.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "capture/dice.h"
#include "estimator/ballistics.h"

namespace throwcal {
namespace {

constexpr double pi = std::numbers::pi;
constexpr double lead_s = 1.2;  ///< quiet before the first throw: a detector learns its background
constexpr double swing_s = 0.5, follow_through_s = 0.35;
constexpr double bounce_s = 0.5;       ///< shorter than the slowest throw's second arc
constexpr double back_swing_s = 0.12;  ///< how far the swing begins behind: this times the velocity
constexpr double restitution = 0.7, friction = 0.85;
constexpr double ball_diameter_m = 0.0657;
constexpr double max_release_jitter_s = 0.04;

enum Stream : std::uint64_t { of_camera, of_throw };

struct Landing {
  double after_s;
  BallState state;
};

/// When and how a ball comes down to a height. Newton, from landing to landing: only the first step
/// is a long flight.
Landing landing(const BallState& start, double floor_m, const Eigen::Vector3d& gravity,
                double drag) {
  const double drop = std::max(0.0, start.position_m.z() - floor_m), up = start.velocity_mps.z();
  double step_s = (up + std::sqrt(up * up - 2.0 * gravity.z() * drop)) / -gravity.z();
  Landing at{0.0, start};
  for (int i = 0; i < 5; ++i) {
    at = {at.after_s + step_s, fly(at.state, step_s, gravity, drag)};
    step_s = -(at.state.position_m.z() - floor_m) / at.state.velocity_mps.z();
  }
  return at;
}

/// Displacement of the swinging hand along the throw's velocity [s]: a cubic from rest, `since`
/// from -swing_s to 0, that lets go with slope one.
double swing(double since_s) {
  const double u = since_s / swing_s + 1.0;
  return -back_swing_s * (u * u * (2 * u - 3) + 1) + swing_s * (u * u * (u - 1));
}

}  // namespace

/// One throw, from the hand's swing to where the ball is picked up.
struct SimulatedScene::Toss {
  double release_s = 0.0, hit_s = 0.0, gone_s = 0.0;
  BallState release, bounce;
};

SimulatedScene::SimulatedScene(const SimulatedSceneSettings& settings) : settings_(settings) {
  const double radius = settings.side_m / std::sqrt(2.0);
  std::vector<Rigid> T_site_cam;
  for (int k = 0; k < settings.cameras; ++k) {
    Dice dice(settings.seed, of_camera, static_cast<std::uint64_t>(k));
    const auto near = [&](double middle, double by) {
      return dice.uniform(middle - by, middle + by);
    };
    const double angle = 2 * pi * k / settings.cameras - 0.75 * pi + near(0, 0.03);
    const Eigen::Vector3d centre(radius * std::cos(angle), radius * std::sin(angle),
                                 near(1.2, 0.1));
    const Eigen::Vector3d target(near(0, 0.15), near(0, 0.15), near(1.4, 0.1));
    T_site_cam.push_back(look_at(centre, target, near(0, 0.05)));
    CameraModel model{.lens = Lens::radtan,
                      .width_px = settings.width_px,
                      .height_px = settings.height_px,
                      .fx_px = settings.focal_px * near(1, 0.01),
                      .cx_px = 0.5 * (settings.width_px - 1) + near(0, 6),
                      .cy_px = 0.5 * (settings.height_px - 1) + near(0, 6),
                      .distortion = {near(-0.12, 0.01), near(0.03, 0.005), 3e-4, -2e-4, 0.0},
                      .row_time_s = settings.row_time_s};
    model.fy_px = model.fx_px * near(1, 0.003);
    rig_.cameras.push_back({"cam" + std::to_string(k + 1), model, std::nullopt});
    const double offset_s = near(0, settings.max_offset_s);
    time_offset_s_.push_back(k ? offset_s : 0.0);
    frame_phase_s_.push_back(dice.uniform(0.0, 1.0 / settings.frames_per_s));
  }
  rig_.ball = {.diameter_m = ball_diameter_m, .drag_per_m = 0.0, .estimate_drag = true};
  rig_.gravity_source = "simulated";
  rig_.estimate_offsets = true;

  const Eigen::Vector3d forward = T_site_cam[0].rotation.col(2);
  T_world_site_.rotation = exp_so3({0, 0, -std::atan2(forward.y(), forward.x())});
  T_world_site_.translation = -(T_world_site_.rotation * T_site_cam[0].translation);
  for (const Rigid& pose : T_site_cam) T_world_cam_.push_back(T_world_site_ * pose);
}

RigDescription SimulatedScene::rig() const { return rig_; }
Rigid SimulatedScene::T_world_cam(CameraId camera) const { return T_world_cam_.at(camera); }
double SimulatedScene::time_offset_s(CameraId camera) const { return time_offset_s_.at(camera); }
double SimulatedScene::frame_phase_s(CameraId camera) const { return frame_phase_s_.at(camera); }

SimulatedScene::Toss SimulatedScene::toss(int number) const {
  Dice dice(settings_.seed, of_throw, static_cast<std::uint64_t>(number));
  const Eigen::Vector3d from(dice.uniform(-1, 1), dice.uniform(-1, 1), dice.uniform(0.9, 1.4));
  // More or less across the middle: a ball thrown outwards would leave most cameras' pictures.
  const double heading = std::atan2(-from.y(), -from.x()) + dice.uniform(-0.6 * pi, 0.6 * pi);
  const double speed = dice.uniform(0.6, 2.0);
  const Eigen::Vector3d velocity(speed * std::cos(heading), speed * std::sin(heading),
                                 dice.uniform(3.2, 4.4));
  const Eigen::Vector3d gravity(0, 0, -rig_.gravity_mps2);
  const double floor_m = T_world_site_.translation.z() + 0.5 * ball_diameter_m;

  Toss t;
  t.release = {T_world_site_ * from, T_world_site_.rotation * velocity};
  t.release_s =
      lead_s + number * settings_.throw_interval_s + dice.uniform(0, max_release_jitter_s);
  const Landing ground = landing(t.release, floor_m, gravity, settings_.drag_per_m);
  const double next_swing_s = lead_s - swing_s + (number + 1) * settings_.throw_interval_s;
  t.hit_s = std::min(t.release_s + ground.after_s, next_swing_s);
  t.bounce = ground.state;
  t.bounce.velocity_mps =
      t.bounce.velocity_mps.cwiseProduct(Eigen::Vector3d(friction, friction, -restitution));
  t.gone_s = std::min(t.hit_s + bounce_s, next_swing_s);
  return t;
}

std::optional<SimulatedScene::Toss> SimulatedScene::toss_at(double time_s) const {
  const double number = std::floor((time_s - (lead_s - swing_s)) / settings_.throw_interval_s);
  if (number < 0.0) return std::nullopt;
  Toss found = toss(static_cast<int>(number));
  if (time_s < found.release_s - swing_s) return std::nullopt;
  return found;
}

std::optional<SimulatedScene::Ball> SimulatedScene::ball_at(double time_s) const {
  const auto t = toss_at(time_s);
  if (!t || time_s >= t->gone_s) return std::nullopt;
  Ball ball;
  ball.throw_number =
      static_cast<int>(std::floor((time_s - (lead_s - swing_s)) / settings_.throw_interval_s));
  ball.in_hand = time_s < t->release_s;
  ball.after_bounce = time_s >= t->hit_s;
  const Eigen::Vector3d gravity(0, 0, -rig_.gravity_mps2);
  if (ball.in_hand)
    ball.position_world_m =
        t->release.position_m + swing(time_s - t->release_s) * t->release.velocity_mps;
  else if (ball.after_bounce)
    ball.position_world_m =
        fly(t->bounce, time_s - t->hit_s, gravity, settings_.drag_per_m).position_m;
  else
    ball.position_world_m =
        fly(t->release, time_s - t->release_s, gravity, settings_.drag_per_m).position_m;
  return ball;
}

std::optional<Eigen::Vector3d> SimulatedScene::hand_at(double time_s) const {
  const auto t = toss_at(time_s);
  if (!t || time_s >= t->release_s + follow_through_s) return std::nullopt;
  const double since_s = time_s - t->release_s;
  const double along_s = since_s < 0 ? swing(since_s) : since_s * std::exp(-9.0 * since_s);
  const double sink_m = since_s < 0 ? 0.0 : 3.0 * since_s * since_s;
  return t->release.position_m + along_s * t->release.velocity_mps - Eigen::Vector3d(0, 0, sink_m);
}

std::vector<SimulatedScene::Arc> SimulatedScene::arc_list(double from_s, double to_s) const {
  std::vector<Arc> arcs;
  const auto add = [&](const Arc& arc) {
    if (arc.start_s >= from_s && arc.start_s < to_s && arc.end_s > arc.start_s) arcs.push_back(arc);
  };
  // One throw early: a bounce may start in the span though its throw did not.
  const double first = std::floor((from_s - lead_s) / settings_.throw_interval_s) - 1.0;
  for (int n = static_cast<int>(std::max(0.0, first));
       lead_s + n * settings_.throw_interval_s < to_s; ++n) {
    const Toss t = toss(n);
    add({n, false, t.release_s, t.hit_s, t.release.position_m, t.release.velocity_mps});
    add({n, true, t.hit_s, t.gone_s, t.bounce.position_m, t.bounce.velocity_mps});
  }
  return arcs;
}

}  // namespace throwcal
