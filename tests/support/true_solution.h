// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <Eigen/Dense>
#include <random>
#include <vector>

#include "estimator/super_state.h"
#include "estimator/throw_set.h"
#include "tests/support/thrower.h"

namespace throwcal::test {

/// The truth of a recording in the estimator's terms: balls at their throws' epochs.
inline Solution true_solution(const Thrown& thrown, const std::vector<TimedThrow>& timed) {
  Solution out{unplaced(thrown.rig), {}};
  out.rig.T_world_cam = thrown.T_world_cam;
  out.rig.time_offset_s = thrown.time_offset_s;
  out.rig.drag_per_m = thrown.flights.empty() ? 0.0 : thrown.flights[0].drag_per_m;
  out.rig.is_placed.assign(thrown.T_world_cam.size(), true);
  for (std::size_t j = 0; j < timed.size(); ++j) {
    const Flight& flight = thrown.flights[j];
    out.balls.push_back(fly({flight.position_world_m, flight.velocity_world_mps},
                            seconds(timed[j].epoch - flight.start),
                            {0, 0, -thrown.rig.gravity_mps2}, flight.drag_per_m));
  }
  return out;
}

/// The same, moved off the truth: every rotation, position and ball by a random vector of the given
/// size.
inline Solution rough_start(Solution at, double rotation_rad, double position_m,
                            double velocity_mps, std::uint64_t seed) {
  std::mt19937_64 engine(seed);
  std::normal_distribution<double> normal;
  const auto direction = [&] {
    return Eigen::Vector3d(normal(engine), normal(engine), normal(engine)).normalized().eval();
  };
  const Eigen::Matrix<double, 3, 2> turns = camera_one_turns(at.rig.T_world_cam[0]);
  for (std::size_t k = 0; k < at.rig.cameras(); ++k) {
    Rigid& pose = at.rig.T_world_cam[k];
    const Eigen::Vector3d move = position_m * direction(), turn = rotation_rad * direction();
    if (k == 0) {  // keeps its place and heading
      const Eigen::Vector2d amount =
          (turns.transpose() * turns).inverse() * turns.transpose() * turn;
      pose.rotation = exp_so3({0, amount[0], 0}) * pose.rotation * exp_so3({0, 0, amount[1]});
      continue;
    }
    pose.translation += move;
    pose.rotation = exp_so3(turn) * pose.rotation;
  }
  at.rig.drag_per_m = 0.0;
  std::fill(at.rig.time_offset_s.begin(), at.rig.time_offset_s.end(), 0.0);
  for (BallState& ball : at.balls)
    ball.position_m += position_m * direction(), ball.velocity_mps += velocity_mps * direction();
  return at;
}

/// A camera's error (x y z rx ry rz), truth minus estimate, R_true = exp([r]x) R_estimate.
inline Eigen::Matrix<double, 6, 1> pose_error(const Thrown& truth, const RigState& estimate,
                                              std::size_t k) {
  Eigen::Matrix<double, 6, 1> error;
  const Rigid &t = truth.T_world_cam[k], &e = estimate.T_world_cam[k];
  error << t.translation - e.translation, log_so3(t.rotation * e.rotation.transpose());
  return error;
}

/// The error of the rig's whole vector, truth minus estimate, in the layout's order.
inline Eigen::VectorXd rig_error(const Thrown& truth, const RigState& estimate) {
  const RigLayout layout(truth.rig, estimate);
  Eigen::VectorXd error = Eigen::VectorXd::Zero(layout.size());
  for (std::size_t k = 0; k < estimate.cameras(); ++k) {
    const RigLayout::Camera& camera = layout.camera(k);
    const Eigen::Matrix<double, 6, 1> pose = pose_error(truth, estimate, k);
    const Eigen::Matrix<double, 3, 2> turns = camera_one_turns(estimate.T_world_cam[0]);
    if (k == 0)
      error.segment<2>(camera.start) =
          (turns.transpose() * turns).inverse() * turns.transpose() * pose.tail<3>();
    else
      error.segment<6>(camera.start) = pose;
    if (camera.offset)
      error[camera.start + *camera.offset] = truth.time_offset_s[k] - estimate.time_offset_s[k];
    for (std::size_t i = 0; i < camera.intrinsics.size(); ++i)
      error[camera.start + camera.lens + static_cast<int>(i)] =
          truth.true_models[k].at(camera.intrinsics[i]) -
          estimate.models[k].at(camera.intrinsics[i]);
  }
  if (layout.drag()) error[*layout.drag()] = truth.flights[0].drag_per_m - estimate.drag_per_m;
  return error;
}

}  // namespace throwcal::test
