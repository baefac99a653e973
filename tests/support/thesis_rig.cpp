// SPDX-License-Identifier: BSD-3-Clause
#include "tests/support/thesis_rig.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <random>

namespace throwcal::test {
namespace {

constexpr double gravity_mps2 = RigDescription{}.gravity_mps2;
constexpr int most_frames = 30;

/// Our camera frame has x right and y down.
const Eigen::Matrix3d flip = Eigen::Vector3d(-1, -1, 1).asDiagonal();

Eigen::Matrix3d turn_y(double angle_rad) { return exp_so3({0, -angle_rad, 0}); }

/// x_thesis = y, y_thesis = z, z_thesis = x.
Eigen::Matrix3d renamed_axes() {
  Eigen::Matrix3d world_basis;
  world_basis << 0, 0, 1, 1, 0, 0, 0, 1, 0;
  return world_basis;
}

/// Both frames stand in camera 1; they differ in heading, which ours takes from camera 1's viewing
/// direction.
Rigid T_world_basis(const ThesisPoses& p) {
  const Eigen::Vector3d forward = renamed_axes() * p.R1.row(2).transpose();
  return {exp_so3({0, 0, -std::atan2(forward.y(), forward.x())}) * renamed_axes(),
          Eigen::Vector3d::Zero()};
}

Rigid T_basis_cam(const Eigen::Matrix3d& R, const Eigen::Vector3d& C) {
  return {R.transpose() * flip, C};
}

/// Section 7.2: fc, cc, alpha_c (skew = alpha_c fx), kc = [k1 k2 p1].
CameraModel camera_model(const ThesisExperiment& e, std::size_t k) {
  CameraModel m{.width_px = 354, .height_px = 248};
  if (k == 0) {
    m.fx_px = 277.44915, m.fy_px = 298.32608, m.cx_px = 183.64332, m.cy_px = 117.42620;
    m.skew_px = -0.00084 * m.fx_px, m.distortion = {-0.42093, 0.20117, -0.00270};
  } else {
    m.fx_px = 270.39002, m.fy_px = 291.26888, m.cx_px = 180.25090, m.cy_px = 118.13432;
    m.skew_px = -0.00026 * m.fx_px, m.distortion = {-0.39303, 0.14915, -0.00353};
  }
  if (!e.is_real) m.distortion = {};
  return m;
}

}  // namespace

Eigen::Matrix3d turn_x(double angle_rad) { return exp_so3({-angle_rad, 0, 0}); }
Eigen::Matrix3d turn_z(double angle_rad) { return exp_so3({0, 0, -angle_rad}); }

ThesisPoses thesis_poses(const ThesisCameras& c) {
  return {turn_x(c[1]) * turn_z(c[0]), turn_z(c[4]) * turn_x(c[3]) * turn_z(c[2]), c.tail<3>()};
}

ThesisCameras thesis_cameras(const ThesisPoses& p) {
  ThesisCameras c;
  c << std::atan2(p.R1(0, 1), p.R1(0, 0)), std::atan2(p.R1(1, 2), p.R1(2, 2)),
      std::atan2(p.R2(2, 0), -p.R2(2, 1)), std::acos(std::clamp(p.R2(2, 2), -1.0, 1.0)),
      std::atan2(p.R2(0, 2), p.R2(1, 2)), p.C2;
  return c;
}

ThesisEstimate thesis_estimate(const std::vector<Rigid>& T_world_cam,
                               const std::vector<BallState>& balls) {
  const auto R = [&](std::size_t k) -> Eigen::Matrix3d {
    return flip * T_world_cam[k].rotation.transpose() * renamed_axes();
  };
  const Eigen::Matrix3d heading = turn_y(-std::atan2(R(0)(0, 2), R(0)(0, 0)));
  const Eigen::Matrix3d basis_world = heading * renamed_axes().transpose();
  ThesisEstimate out{{R(0) * heading.transpose(), R(1) * heading.transpose(),
                      basis_world * T_world_cam[1].translation},
                     {}};
  for (const BallState& ball : balls)
    out.balls.push_back({basis_world * ball.position_m, basis_world * ball.velocity_mps});
  return out;
}

Sight sight_of(const ThesisExperiment& e, const ThesisPoses& p, const Eigen::Vector3d& X) {
  return {camera_model(e, 0).project(flip * (p.R1 * X)),
          camera_model(e, 1).project(flip * (p.R2 * (X - p.C2)))};
}

Eigen::Vector3d flown(const ThesisBall& ball, double time_s) {
  return fly({ball.X, ball.V}, time_s, {0, -gravity_mps2, 0}, 0.0).position_m;
}

std::vector<SeenFrame> seen_frames(const ThesisExperiment& e, const ThesisThrow& thrown) {
  std::vector<SeenFrame> out;
  int in_camera2 = 0;
  for (int n = 0; n < most_frames; ++n) {
    SeenFrame frame{n / (e.is_real ? 25.0 : 30.0), {}};
    const Sight sight = sight_of(e, thesis_poses(e.truth), flown(thrown.truth, frame.time_s));
    for (std::size_t k = 0; k < 2; ++k)
      frame.by[k] = sight[k] && (!e.is_real || camera_model(e, k).contains(*sight[k]));
    if (frame.by[1]) frame.by[1] = ++in_camera2 <= thrown.most_in_camera2;
    out.push_back(frame);
  }
  return out;
}

HostTime first_frame(std::size_t j) {
  return HostTime(from_seconds(1.0 + 2.0 * static_cast<double>(j)));
}

ThesisRecording record(const ThesisExperiment& e, std::uint64_t seed) {
  std::mt19937_64 engine(seed);
  std::normal_distribution<double> normal;
  ThesisRecording out;
  out.rig.estimate_offsets = false;
  for (std::size_t k = 0; k < 2; ++k)
    out.rig.cameras.push_back({"Cam" + std::to_string(k + 1), camera_model(e, k), std::nullopt});
  std::uint64_t id = 0;
  for (std::size_t j = 0; j < e.throws.size(); ++j) {
    Throw thrown{std::to_string(j + 1), {Track{0, {}}, Track{1, {}}}};
    for (const SeenFrame& frame : seen_frames(e, e.throws[j])) {
      Eigen::Vector3d X = flown(e.throws[j].truth, frame.time_s);
      for (double& x : X) x += e.sigma_ball_m * normal(engine);
      const Sight sight = sight_of(e, thesis_poses(e.truth), X);
      for (CameraId k = 0; k < 2; ++k) {
        const Eigen::Vector2d noise(normal(engine), normal(engine));
        if (frame.by[k] && sight[k])
          thrown.tracks[k].sightings.push_back({k, first_frame(j) + from_seconds(frame.time_s),
                                                *sight[k] + e.sigma_px * noise,
                                                Eigen::Matrix2d::Identity(), std::nullopt, id++});
      }
    }
    out.throws.push_back(std::move(thrown));
  }
  return out;
}

Solution guessed_solution(const ThesisExperiment& e, const RigDescription& rig,
                          const std::vector<TimedThrow>& throws) {
  const ThesisPoses guess = thesis_poses(e.guess);
  // The operator guesses from where camera 1 really stands and looks. What the guess says of camera
  // 1's own heading is no guess but the gauge, and goes.
  const Rigid world = T_world_basis(thesis_poses(e.truth));
  Solution out{unplaced(rig), {}};
  out.rig.T_world_cam = {T_world_basis(guess) * T_basis_cam(guess.R1, Eigen::Vector3d::Zero()),
                         world * T_basis_cam(guess.R2, guess.C2)};
  out.rig.is_placed = {true, true};
  for (std::size_t j = 0; j < throws.size(); ++j) {
    const ThesisBall& ball = e.throws[j].guess;
    out.balls.push_back(fly({world.rotation * ball.X, world.rotation * ball.V},
                            seconds(throws[j].epoch - first_frame(j)), {0, 0, -gravity_mps2}, 0.0));
  }
  return out;
}

}  // namespace throwcal::test
