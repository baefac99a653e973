// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <random>
#include <vector>

#include "estimator/super_state.h"
#include "estimator/throw_set.h"
#include "tests/support/thrower.h"

namespace throwcal::test {

/// The truth of a recording in the estimator's terms: balls at their throws' epochs.
inline Solution true_solution(const Thrown& thrown, const std::vector<TimedThrow>& timed) {
  Solution out{{thrown.T_world_cam, thrown.time_offset_s,
                thrown.flights.empty() ? 0.0 : thrown.flights[0].drag_per_m,
                std::vector<bool>(thrown.T_world_cam.size(), true)},
               {}};
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
  Eigen::VectorXd step = Eigen::VectorXd::Zero(slice::rig_size(at.rig.cameras()));
  for (std::size_t k = 0; k < at.rig.cameras(); ++k) {
    step.segment<3>(slice::camera(k) + slice::translation) = position_m * direction();
    step.segment<3>(slice::camera(k) + slice::rotation) = rotation_rad * direction();
  }
  at.rig.apply(step);
  at.rig.drag_per_m = 0.0;
  std::fill(at.rig.time_offset_s.begin(), at.rig.time_offset_s.end(), 0.0);
  for (BallState& ball : at.balls)
    ball.position_m += position_m * direction(), ball.velocity_mps += velocity_mps * direction();
  return at;
}

/// The rig's error vector (rig_size): truth minus estimate, rotations as R_true = exp([r]x)
/// R_estimate.
inline Eigen::VectorXd rig_error(const Thrown& truth, const RigState& estimate) {
  Eigen::VectorXd error = Eigen::VectorXd::Zero(slice::rig_size(estimate.cameras()));
  for (std::size_t k = 0; k < estimate.cameras(); ++k) {
    const Rigid &t = truth.T_world_cam[k], &e = estimate.T_world_cam[k];
    error.segment<3>(slice::camera(k)) = t.translation - e.translation;
    error.segment<3>(slice::camera(k) + slice::rotation) =
        log_so3(t.rotation * e.rotation.transpose());
    error[slice::camera(k) + slice::offset] = truth.time_offset_s[k] - estimate.time_offset_s[k];
  }
  error[slice::drag(estimate.cameras())] = truth.flights[0].drag_per_m - estimate.drag_per_m;
  return error;
}

}  // namespace throwcal::test
