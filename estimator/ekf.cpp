// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/ekf.h"

#include <Eigen/Dense>
#include <cmath>

namespace throwcal {

using slice::ball_size;

Ekf::Ekf(const RigDescription& rig, const RigState& start, const EkfSettings& settings)
    : rig_(rig), settings_(settings), rig_state_(start) {
  const int size = ball_size + slice::rig_size(start.cameras());
  covariance_.setZero(size, size);
  gain_.setZero(size, 2), cross_.setZero(size, 2), rows_.setZero(6, size), step_.setZero(size);
  reset_rig_covariance();
}

void Ekf::reset_rig_covariance() {
  const std::size_t cameras = rig_state_.cameras();
  Eigen::VectorXd sigma(slice::rig_size(cameras));
  for (std::size_t k = 0; k < cameras; ++k) {
    sigma.segment<3>(slice::camera(k) + slice::translation).setConstant(settings_.prior_position_m);
    sigma.segment<3>(slice::camera(k) + slice::rotation).setConstant(settings_.prior_rotation_rad);
    sigma[slice::camera(k) + slice::offset] = settings_.prior_offset_s;
  }
  sigma[slice::drag(cameras)] = settings_.prior_drag_per_m;
  const Eigen::MatrixXd free = gauge_directions(rig_, rig_state_);
  covariance_.setZero();
  // Each free direction is one coordinate, but for camera 1's two turns, which share a block of one
  // sigma.
  const Eigen::VectorXd own =
      (free.array().square().matrix().transpose() * sigma.array().square().matrix())
          .cwiseQuotient(free.colwise().squaredNorm().transpose());
  covariance_.bottomRightCorner(sigma.size(), sigma.size()) =
      free * own.asDiagonal() * free.transpose();
}

void Ekf::start_throw(const BallState& ball) {
  ball_ = ball;
  time_s_ = 0.0;
  covariance_.topRows<ball_size>().setZero();
  covariance_.leftCols<ball_size>().setZero();
  covariance_.diagonal()
      .segment<3>(slice::ball_position)
      .setConstant(std::pow(settings_.prior_ball_position_m, 2));
  covariance_.diagonal()
      .segment<3>(slice::ball_velocity)
      .setConstant(std::pow(settings_.prior_ball_velocity_mps, 2));
}

void Ekf::predict(double time_s) {
  const double step_s = time_s - time_s_;
  if (step_s == 0.0) return;
  const Propagation p = propagate(ball_, step_s, {0, 0, -rig_.gravity_mps2}, rig_state_.drag_per_m);
  ball_ = p.state;
  time_s_ = time_s;
  // P <- F P F^T where only the ball's rows of F differ from the identity:
  // position' = position + J_pv velocity + J_pd drag, velocity' = J_vv velocity + J_vd drag.
  const Eigen::Index drag = covariance_.rows() - 1;
  rows_ = covariance_.topRows<6>();
  rows_.topRows<3>().noalias() +=
      p.J_position_velocity0 * covariance_.middleRows<3>(slice::ball_velocity);
  rows_.topRows<3>().noalias() += p.J_position_drag * covariance_.row(drag);
  rows_.bottomRows<3>().noalias() =
      p.J_velocity_velocity0 * covariance_.middleRows<3>(slice::ball_velocity);
  rows_.bottomRows<3>().noalias() += p.J_velocity_drag * covariance_.row(drag);
  Eigen::Matrix<double, 6, 6> own = rows_.leftCols<6>();
  own.leftCols<3>() +=
      rows_.middleCols<3>(slice::ball_velocity) * p.J_position_velocity0.transpose() +
      rows_.col(drag) * p.J_position_drag.transpose();
  own.rightCols<3>() =
      rows_.middleCols<3>(slice::ball_velocity) * p.J_velocity_velocity0.transpose() +
      rows_.col(drag) * p.J_velocity_drag.transpose();
  const Eigen::Index rest = covariance_.rows() - ball_size;
  covariance_.topRightCorner(ball_size, rest) = rows_.rightCols(rest);
  covariance_.bottomLeftCorner(rest, ball_size) = rows_.rightCols(rest).transpose();
  covariance_.topLeftCorner<6, 6>() = 0.5 * (own + own.transpose());

  const double elapsed_s = std::abs(step_s);
  covariance_.diagonal().segment<3>(slice::ball_velocity).array() +=
      std::pow(settings_.process_acceleration_mps2, 2) * elapsed_s;
  for (Eigen::Index i = ball_size; i < covariance_.rows(); ++i)
    if (covariance_(i, i) > 0) covariance_(i, i) += settings_.pseudo_noise_variance * elapsed_s;
}

void Ekf::update(const TimedSighting& sighting) {
  const std::size_t k = sighting.camera;
  predict(sighting.time_s + rig_state_.time_offset_s[k]);
  const auto model =
      model_sighting(rig_.cameras[k].model, rig_state_.T_world_cam[k], ball_, sighting);
  if (!model) return;
  const int at = ball_size + slice::camera(k);
  // H has two blocks only: the ball's position and the camera's seven.
  cross_.noalias() = covariance_.leftCols<3>() * model->J_position.transpose();
  cross_.noalias() += covariance_.middleCols<slice::camera_size>(at) * model->J_camera.transpose();
  Eigen::Matrix2d innovation = model->J_position * cross_.topRows<3>() +
                               model->J_camera * cross_.middleRows<slice::camera_size>(at);
  const double noise = settings_.noise_px * settings_.noise_px;
  innovation += noise * Eigen::Matrix2d::Identity();
  const double distance =
      std::sqrt(model->residual_px.dot(innovation.inverse() * model->residual_px));
  if (!std::isfinite(distance)) return;
  if (distance > settings_.huber_sigmas) innovation *= distance / settings_.huber_sigmas;
  gain_.noalias() = cross_ * innovation.inverse();
  step_.noalias() = gain_ * model->residual_px;
  // P <- P - (P H^T) S^-1 (P H^T)^T, one triangle, then mirrored: exactly symmetric, or rounding
  // grows with every pass.
  const Eigen::Matrix2d root = innovation.llt().matrixL();
  cross_.col(0) /= root(0, 0);
  cross_.col(1) = (cross_.col(1) - root(1, 0) * cross_.col(0)) / root(1, 1);
  covariance_.selfadjointView<Eigen::Lower>().rankUpdate(cross_, -1.0);
  covariance_.triangularView<Eigen::StrictlyUpper>() = covariance_.transpose();

  ball_.position_m += step_.segment<3>(slice::ball_position);
  ball_.velocity_mps += step_.segment<3>(slice::ball_velocity);
  rig_state_.apply(step_.tail(step_.size() - ball_size));
}

}  // namespace throwcal
