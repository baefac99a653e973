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
  for (auto& side : nodes_) side.reserve(32), side.push_back(now_);
}

const Propagation* FlightPath::nodes_to(int last, bool before) {
  std::vector<Propagation>& side = nodes_[before];
  const double step_s = before ? -node_s : node_s;
  while (static_cast<int>(side.size()) <= last) {
    if (wants_ == Wants::sensitivities) {
      side.push_back(propagate_on(side.back(), step_s, gravity_mps2_, drag_per_m_));
    } else {
      const BallState next = fly(side.back().state, step_s, gravity_mps2_, drag_per_m_);
      side.emplace_back().state = next;
    }
  }
  return side.data();
}

void FlightPath::interpolate(double time_s) {
  const int n = static_cast<int>(std::floor(time_s / node_s));
  const Propagation* side = nodes_to(n < 0 ? -n : n + 1, n < 0);
  const Propagation &a = side[std::abs(n)], &b = side[std::abs(n + 1)];
  const double u = time_s / node_s - n, v = 1 - u;
  const double a0 = v * v * (1 + 2 * u), b0 = u * u * (1 + 2 * v);
  const double a1 = node_s * u * v * v, b1 = -node_s * u * u * v;
  const auto cubic = [&](const auto& pa, const auto& va, const auto& pb, const auto& vb) {
    return a0 * pa + a1 * va + b0 * pb + b1 * vb;
  };
  now_.state.position_m =
      cubic(a.state.position_m, a.state.velocity_mps, b.state.position_m, b.state.velocity_mps);
  const double rate = 6 * u * v / node_s;
  now_.state.velocity_mps = rate * (b.state.position_m - a.state.position_m) +
                            v * (1 - 3 * u) * a.state.velocity_mps +
                            u * (1 - 3 * v) * b.state.velocity_mps;
  if (wants_ == Wants::state) return;
  now_.J_position_velocity0 = cubic(a.J_position_velocity0, a.J_velocity_velocity0,
                                    b.J_position_velocity0, b.J_velocity_velocity0);
  now_.J_position_drag =
      cubic(a.J_position_drag, a.J_velocity_drag, b.J_position_drag, b.J_velocity_drag);
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
