// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/linearisation.h"

#include <algorithm>
#include <limits>

#include "estimator/flight_path.h"

namespace throwcal {
namespace {

constexpr double not_seen = std::numeric_limits<double>::quiet_NaN();

void fill_rows(const SightingModel& model, const Propagation& ball,
               const std::vector<Intrinsic>& estimated, int columns, double* rows) {
  const Eigen::Matrix<double, 2, 3> J_velocity =
      model.J_position.lazyProduct(ball.J_position_velocity0);
  const Eigen::Vector2d J_drag = model.J_position.lazyProduct(ball.J_position_drag);
  for (int i = 0; i < 2; ++i, rows += columns) {
    for (int c = 0; c < 3; ++c) {
      rows[Linearisation::position + c] = model.J_position(i, c);
      rows[Linearisation::velocity + c] = J_velocity(i, c);
      rows[Linearisation::rotation + c] = model.J_rotation(i, c);
    }
    rows[Linearisation::offset] = model.J_offset[i];
    rows[Linearisation::drag] = J_drag[i];
    rows[Linearisation::residual] = model.residual_px[i];
    for (int n = 0; n < columns - Linearisation::lens; ++n)
      rows[Linearisation::lens + n] = static_cast<std::size_t>(n) < estimated.size()
                                          ? model.J_lens(i, static_cast<int>(estimated[n]))
                                          : 0.0;
  }
}

}  // namespace

PerSighting<Eigen::Vector2d> Linearisation::residuals() const {
  PerSighting<Eigen::Vector2d> out(rows.size());
  for (std::size_t j = 0; j < rows.size(); ++j) {
    out[j].reserve(rows[j].size() / (2 * columns));
    for (const double* r = rows[j].data(); r != rows[j].data() + rows[j].size(); r += 2 * columns)
      out[j].emplace_back(r[residual], r[columns + residual]);
  }
  return out;
}

void linearise(const RigDescription& rig, const std::vector<TimedThrow>& throws, const Solution& at,
               Linearisation& out) {
  std::size_t lens_numbers = 0;
  for (const CameraDescription& camera : rig.cameras)
    lens_numbers = std::max(lens_numbers, camera.estimate.size());
  out.columns = Linearisation::plain_columns + static_cast<int>(lens_numbers);
  out.rows.resize(throws.size());
  SightingModel model;
  for (std::size_t j = 0; j < throws.size(); ++j) {
    FlightPath path(at.balls[j], {0, 0, -rig.gravity_mps2}, at.rig.drag_per_m,
                    FlightPath::Wants::sensitivities, rig.ball.estimate_drag);
    out.rows[j].resize(2 * out.columns * throws[j].sightings.size());
    double* rows = out.rows[j].data();
    for (const TimedSighting& s : throws[j].sightings) {
      const std::vector<Intrinsic>& estimated = rig.cameras[s.camera].estimate;
      const Propagation& ball = path.at(moment_s(at.rig, s));
      if (model_sighting(at.rig, ball.state, s, !estimated.empty(), true, model))
        fill_rows(model, ball, estimated, out.columns, rows);
      else
        rows[Linearisation::residual] = rows[out.columns + Linearisation::residual] = not_seen;
      rows += 2 * out.columns;
    }
  }
}

PerSighting<Eigen::Vector2d> claimed_residuals(const RigDescription& rig,
                                               const std::vector<TimedThrow>& throws,
                                               const Solution& at) {
  const Eigen::Vector3d gravity(0, 0, -rig.gravity_mps2);
  PerSighting<Eigen::Vector2d> out(throws.size());
  for (std::size_t j = 0; j < throws.size(); ++j) {
    out[j].reserve(throws[j].sightings.size());
    FlightPath path(at.balls[j], gravity, at.rig.drag_per_m, FlightPath::Wants::state, false);
    for (const TimedSighting& s : throws[j].sightings) {
      const auto residual = residual_px(at.rig, path.at(moment_s(at.rig, s)).state, s);
      out[j].push_back(residual
                           ? Eigen::Vector2d(s.whitening * *residual)
                           : Eigen::Vector2d::Constant(std::numeric_limits<double>::quiet_NaN()));
    }
  }
  return out;
}

}  // namespace throwcal
