// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/flight_path.h"

#include <cmath>
#include <limits>

namespace throwcal {
namespace {

constexpr double node_s = 0.025;

}  // namespace

FlightPath::FlightPath(const BallState& at_zero, const Eigen::Vector3d& gravity_mps2,
                       double drag_per_m, Wants wants, bool wants_drag_derivative)
    : at_zero_(at_zero),
      gravity_mps2_(gravity_mps2),
      drag_per_m_(drag_per_m),
      wants_(wants),
      is_parabola_(drag_per_m == 0.0 && !(wants == Wants::sensitivities && wants_drag_derivative)),
      now_{at_zero, Eigen::Matrix3d::Zero(), Eigen::Matrix3d::Identity(), Eigen::Vector3d::Zero(),
           Eigen::Vector3d::Zero()} {
  if (is_parabola_) return;
  last_ = {now_, now_};
  for (auto& side : nodes_) side.reserve(32);
}

const FlightPath::Node* FlightPath::nodes_to(int last, bool before) {
  std::vector<Node>& side = nodes_[before];
  Propagation& at = last_[before];
  const double step_s = before ? -node_s : node_s;
  while (static_cast<int>(side.size()) <= last) {
    if (!side.empty()) {
      if (wants_ == Wants::sensitivities)
        at = propagate_on(at, step_s, gravity_mps2_, drag_per_m_);
      else
        at.state = fly(at.state, step_s, gravity_mps2_, drag_per_m_);
    }
    Node& node = side.emplace_back();
    node.value.head<3>() = at.state.position_m, node.rate.head<3>() = at.state.velocity_mps;
    if (wants_ == Wants::state) continue;
    node.value.segment<9>(3) = at.J_position_velocity0.reshaped().array();
    node.rate.segment<9>(3) = at.J_velocity_velocity0.reshaped().array();
    node.value.segment<3>(12) = at.J_position_drag, node.rate.segment<3>(12) = at.J_velocity_drag;
    node.value[15] = node.rate[15] = 0.0;
  }
  return side.data();
}

void FlightPath::interpolate(double time_s) {
  const int n = static_cast<int>(std::floor(time_s / node_s));
  const Node* side = nodes_to(n < 0 ? -n : n + 1, n < 0);
  const Node &a = side[std::abs(n)], &b = side[std::abs(n + 1)];
  const double u = time_s / node_s - n, v = 1 - u;
  const double a0 = v * v * (1 + 2 * u), b0 = u * u * (1 + 2 * v);
  const double a1 = node_s * u * v * v, b1 = -node_s * u * u * v;
  const double rate = 6 * u * v / node_s;
  now_.state.velocity_mps =
      (rate * (b.value.head<3>() - a.value.head<3>()) + v * (1 - 3 * u) * a.rate.head<3>() +
       u * (1 - 3 * v) * b.rate.head<3>())
          .matrix();
  if (wants_ == Wants::state) {
    now_.state.position_m = a0 * a.value.head<3>() + a1 * a.rate.head<3>() +
                            b0 * b.value.head<3>() + b1 * b.rate.head<3>();
    return;
  }
  const Eigen::Array<double, 16, 1> here = a0 * a.value + a1 * a.rate + b0 * b.value + b1 * b.rate;
  now_.state.position_m = here.head<3>();
  now_.J_position_velocity0.reshaped() = here.segment<9>(3).matrix();
  now_.J_position_drag = here.segment<3>(12);
}

const Propagation& FlightPath::at(double time_s) {
  if (!(std::abs(time_s) <= max_flight_s)) {
    now_.state.position_m.setConstant(std::numeric_limits<double>::quiet_NaN());
  } else if (is_parabola_) {
    now_.state = fly(at_zero_, time_s, gravity_mps2_, 0.0);
    now_.J_position_velocity0 = time_s * Eigen::Matrix3d::Identity();
  } else {
    interpolate(time_s);
  }
  return now_;
}

}  // namespace throwcal
