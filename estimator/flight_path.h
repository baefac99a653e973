// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <Eigen/Core>
#include <array>
#include <vector>

#include "estimator/ballistics.h"

namespace throwcal {

/// One flight asked for at many times in any order, with its sensitivities to the state at time 0.
/// Integrated once, node by node as far as is asked for, and interpolated by cubics that meet
/// positions and velocities at both ends (Hermite): under 10 nm off for a tennis ball, 0.1 um for
/// table tennis at 12 m/s. Parabolas are exact.
class FlightPath {
 public:
  enum class Wants { state, sensitivities };

  /// `gravity` in the state's axes [m/s^2].
  FlightPath(const BallState& at_zero, const Eigen::Vector3d& gravity_mps2, double drag_per_m,
             Wants wants, bool wants_drag_derivative);

  /// The ball at a time [s] from time 0 and, where wanted, its position's derivatives by velocity
  /// and drag (not the velocity's). Not finite past max_flight_s. Valid until the next call.
  const Propagation& at(double time_s);

 private:
  /// What is interpolated, and its rates: position 3, by velocity 9, by drag 3 (and one over).
  struct Node {
    Eigen::Array<double, 16, 1> value, rate;
  };
  /// At multiples of node_s, ahead of time 0 or before it, as far as the last.
  const Node* nodes_to(int last, bool before);
  void interpolate(double time_s);

  BallState at_zero_;
  Eigen::Vector3d gravity_mps2_;
  double drag_per_m_;
  Wants wants_;
  bool is_parabola_;
  // Ahead of time 0 and before it, both from it, and how far each has come.
  std::array<std::vector<Node>, 2> nodes_;
  std::array<Propagation, 2> last_;
  Propagation now_;
};

}  // namespace throwcal
