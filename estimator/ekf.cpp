// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/ekf.h"

#include <Eigen/Dense>
#include <cmath>

#include "estimator/elementary.h"

namespace throwcal {
namespace {

constexpr int ball_size = RigLayout::ball_size;
constexpr int position = RigLayout::ball_position, velocity = RigLayout::ball_velocity;

/// How roughly a lens number that is to be estimated is known beforehand, 1-sigma in its own unit.
double prior_sigma(Intrinsic which, const CameraModel& model) {
  switch (which) {
    case Intrinsic::fx:
    case Intrinsic::fy:
      return 0.02 * model.fx_px;
    case Intrinsic::cx:
    case Intrinsic::cy:
      return 0.02 * model.width_px;
    case Intrinsic::skew:
      return 1.0;
    case Intrinsic::row_time:
      return 1e-5;
    default:
      return 0.05;
  }
}

}  // namespace

Ekf::Ekf(const RigDescription& rig, const RigState& start, const EkfSettings& settings)
    : rig_(rig), settings_(settings), rig_state_(start), layout_(rig, start) {
  const int size = ball_size + layout_.size();
  covariance_.setZero(size, size);
  cross_.setZero(size, 2), whitened_.setZero(size, 2), step_.setZero(size);
  reset_rig_covariance();
}

void Ekf::reset_rig_covariance() {
  covariance_.setZero();
  auto variance = covariance_.diagonal().tail(layout_.size());
  for (std::size_t k = 0; k < rig_state_.cameras(); ++k) {
    const RigLayout::Camera& camera = layout_.camera(k);
    if (camera.size == 0) continue;
    auto own = variance.segment(camera.start, camera.size);
    own.head(camera.rotation).setConstant(square(settings_.prior_position_m));
    own.segment(camera.rotation, k == 0 ? 2 : 3).setConstant(square(settings_.prior_rotation_rad));
    if (camera.offset) own[*camera.offset] = square(settings_.prior_offset_s);
    for (std::size_t i = 0; i < camera.intrinsics.size(); ++i)
      own[camera.lens + static_cast<int>(i)] =
          square(prior_sigma(camera.intrinsics[i], rig_.cameras[k].model));
  }
  if (layout_.drag()) variance[*layout_.drag()] = square(settings_.prior_drag_per_m);
}

void Ekf::hold_rig() { covariance_.setZero(); }

void Ekf::start_throw(const BallState& ball) {
  ball_ = ball;
  time_s_ = 0.0;
  // Steps keep it symmetric to the last bit, unless a compiler fuses their products unevenly.
  covariance_.triangularView<Eigen::StrictlyUpper>() = covariance_.transpose();
  covariance_.topRows<ball_size>().setZero();
  covariance_.leftCols<ball_size>().setZero();
  covariance_.diagonal().segment<3>(position).setConstant(square(settings_.prior_ball_position_m));
  covariance_.diagonal().segment<3>(velocity).setConstant(
      square(settings_.prior_ball_velocity_mps));
}

void Ekf::propagate_covariance(const Propagation& step) {
  // position' = position + J_pv velocity + J_pd drag, velocity' = J_vv velocity + J_vd drag: of
  // the columns (P F^T), then the same of the rows.
  const int drag = layout_.drag() ? ball_size + *layout_.drag() : -1;
  auto columns = covariance_.leftCols<ball_size>();
  auto rows = covariance_.topRows<ball_size>();
  columns.leftCols<3>() +=
      columns.rightCols<3>().lazyProduct(step.J_position_velocity0.transpose());
  for (Eigen::Index i = 0; i < columns.rows(); ++i)
    columns.row(i).tail<3>() =
        (columns.row(i).tail<3>() * step.J_velocity_velocity0.transpose()).eval();
  if (drag >= 0)
    for (int i = 0; i < 3; ++i) {
      columns.col(position + i) += step.J_position_drag[i] * covariance_.col(drag);
      columns.col(velocity + i) += step.J_velocity_drag[i] * covariance_.col(drag);
    }
  rows.topRows<3>() += step.J_position_velocity0.lazyProduct(rows.bottomRows<3>());
  for (Eigen::Index i = 0; i < rows.cols(); ++i)
    rows.col(i).tail<3>() = (step.J_velocity_velocity0 * rows.col(i).tail<3>()).eval();
  if (drag >= 0)
    for (int i = 0; i < 3; ++i) {
      rows.row(position + i) += step.J_position_drag[i] * covariance_.row(drag);
      rows.row(velocity + i) += step.J_velocity_drag[i] * covariance_.row(drag);
    }
}

void Ekf::predict(double time_s) {
  const double step_s = time_s - time_s_;
  if (step_s == 0.0) return;
  time_s_ = time_s;
  const Eigen::Vector3d gravity(0, 0, -rig_.gravity_mps2);
  if (!layout_.drag() && rig_state_.drag_per_m == 0.0) {
    ball_ = fly(ball_, step_s, gravity, 0.0);
    covariance_.middleCols<3>(position) += step_s * covariance_.middleCols<3>(velocity);
    covariance_.middleRows<3>(position) += step_s * covariance_.middleRows<3>(velocity);
  } else {
    const Propagation step = propagate(ball_, step_s, gravity, rig_state_.drag_per_m);
    ball_ = step.state;
    propagate_covariance(step);
  }
  // In exact arithmetic the ball's own block stays symmetric; the rest does in rounding too.
  auto own = covariance_.topLeftCorner<ball_size, ball_size>();
  own.triangularView<Eigen::StrictlyUpper>() = own.transpose();

  const double elapsed_s = std::abs(step_s);
  covariance_.diagonal().segment<3>(velocity).array() +=
      square(settings_.process_acceleration_mps2) * elapsed_s;
  if (settings_.pseudo_noise_variance > 0)
    covariance_.diagonal().tail(layout_.size()).array() +=
        settings_.pseudo_noise_variance * elapsed_s;
}

template <int camera_size>
void Ekf::cross_covariance(int at) {
  cross_.noalias() = covariance_.middleCols<3>(position).lazyProduct(model_.J_position.transpose());
  const Eigen::Matrix<double, camera_size, 2, 0,
                      camera_size == -1 ? RigLayout::max_camera_size : camera_size, 2>
      H = J_camera_.transpose();
  cross_.noalias() += covariance_.middleCols<camera_size>(at, J_camera_.cols()).lazyProduct(H);
}

void Ekf::update(const TimedSighting& sighting) {
  const std::size_t k = sighting.camera;
  const RigLayout::Camera& camera = layout_.camera(k);
  const double moment = moment_s(rig_state_, sighting);
  if (!(std::abs(moment) <= max_flight_s)) return;  // an offset gone astray
  predict(moment);
  if (!model_sighting(rig_state_, ball_, sighting, !camera.intrinsics.empty(), false, model_))
    return;
  layout_.fill_jacobian(k, model_, camera_one_turns(rig_state_.T_world_cam[0]), J_camera_);
  const int at = ball_size + camera.start;
  switch (camera.size) {
    case 2:
      cross_covariance<2>(at);
      break;
    case 6:
      cross_covariance<6>(at);
      break;
    case 7:
      cross_covariance<7>(at);
      break;
    default:
      cross_covariance<Eigen::Dynamic>(at);
  }
  Eigen::Matrix2d innovation = model_.J_position.lazyProduct(cross_.middleRows<3>(position)) +
                               J_camera_.lazyProduct(cross_.middleRows(at, camera.size));
  innovation.diagonal().array() += square(settings_.noise_rad * rig_.cameras[k].model.fx_px);
  const Eigen::Matrix2d inverse = innovation.inverse();
  const double distance = std::sqrt(model_.residual_px.dot(inverse * model_.residual_px));
  if (!std::isfinite(distance)) return;
  if (distance > settings_.huber_sigmas) innovation *= distance / settings_.huber_sigmas;
  // With S = L L^T and W = P H^T L^-T: the step is W (L^-1 residual), P <- P - W W^T. Element by
  // element it is the same sum on both sides of the diagonal, so P stays exactly symmetric.
  const double l00 = std::sqrt(innovation(0, 0)), l10 = innovation(1, 0) / l00;
  const double l11 = std::sqrt(innovation(1, 1) - l10 * l10);
  if (!(l11 > 0)) return;
  whitened_.col(0) = cross_.col(0) / l00;
  whitened_.col(1) = (cross_.col(1) - l10 * whitened_.col(0)) / l11;
  const double r0 = model_.residual_px[0] / l00;
  const double r1 = (model_.residual_px[1] - l10 * r0) / l11;
  step_ = r0 * whitened_.col(0) + r1 * whitened_.col(1);
  for (Eigen::Index c = 0; c < covariance_.cols(); ++c)
    covariance_.col(c) -= whitened_(c, 0) * whitened_.col(0) + whitened_(c, 1) * whitened_.col(1);

  ball_.position_m += step_.segment<3>(position);
  ball_.velocity_mps += step_.segment<3>(velocity);
  layout_.apply(step_.tail(layout_.size()), rig_state_);
}

}  // namespace throwcal
