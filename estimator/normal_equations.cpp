// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/normal_equations.h"

#include <Eigen/Dense>
#include <cmath>
#include <limits>

#include "estimator/flight_path.h"

namespace throwcal {
namespace {

using Matrix6 = Eigen::Matrix<double, 6, 6>;
constexpr double unseen_cost =
    1e6;  // a sighting whose ball cannot be seen: 1000 sigma, so that no step gains by it

/// Calls visit(index, sighting, model, propagation) for every sighting of a throw; the model is
/// absent where unseen.
template <typename Visit>
void for_each_sighting(const RigDescription& rig, const TimedThrow& thrown, const Solution& at,
                       std::size_t j, Visit visit) {
  FlightPath path(at.balls[j], {0, 0, -rig.gravity_mps2}, at.rig.drag_per_m,
                  rig.ball.estimate_drag);
  for (std::size_t i = 0; i < thrown.sightings.size(); ++i) {
    const TimedSighting& s = thrown.sightings[i];
    const Propagation& ball = path.at(s.time_s + at.rig.time_offset_s[s.camera]);
    visit(i, s,
          model_sighting(rig.cameras[s.camera].model, at.rig.T_world_cam[s.camera], ball.state, s),
          ball);
  }
}

/// Huber's cost and weight of a squared distance.
struct Huber {
  double cost, weight;
};
Huber huber(double squared, double limit) {
  if (limit <= 0.0 || squared <= limit * limit) return {squared, 1.0};
  const double distance = std::sqrt(squared);
  return {2 * limit * distance - limit * limit, limit / distance};
}

/// One throw's share, before its ball is eliminated.
struct ThrowBlocks {
  Matrix6 ball = Matrix6::Zero();
  Eigen::Matrix<double, Eigen::Dynamic, 6> coupling;
  Eigen::Matrix<double, 6, 1> gradient = Eigen::Matrix<double, 6, 1>::Zero();
};

/// Adds one whitened sighting to the rig's and the ball's blocks.
void add_sighting(NormalEquations& rig_part, ThrowBlocks& own, const TimedSighting& s,
                  const SightingModel& model, const Propagation& ball,
                  const Eigen::Matrix2d& whitening, int drag) {
  const Eigen::Vector2d residual = whitening * model.residual_px;
  const Eigen::Matrix<double, 2, 3> J_position = whitening * model.J_position;
  const Eigen::Matrix<double, 2, slice::camera_size> J_camera = whitening * model.J_camera;
  Eigen::Matrix<double, 2, 6> J_ball;
  J_ball << J_position, J_position * ball.J_position_velocity0;
  const Eigen::Vector2d J_drag = J_position * ball.J_position_drag;

  const int at = slice::camera(s.camera);
  constexpr int size = slice::camera_size;
  rig_part.information.block<size, size>(at, at) += J_camera.transpose() * J_camera;
  rig_part.information.block<size, 1>(at, drag) += J_camera.transpose() * J_drag;
  rig_part.information.block<1, size>(drag, at) += J_drag.transpose() * J_camera;
  rig_part.information(drag, drag) += J_drag.squaredNorm();
  rig_part.gradient.segment<size>(at) += J_camera.transpose() * residual;
  rig_part.gradient[drag] += J_drag.dot(residual);
  own.ball += J_ball.transpose() * J_ball;
  own.coupling.middleRows<size>(at) += J_camera.transpose() * J_ball;
  own.coupling.row(drag) += J_drag.transpose() * J_ball;
  own.gradient += J_ball.transpose() * residual;
}

/// Inverse of a ball's information; scaled first, for metres and metres per second differ. A
/// direction that no sighting determines gets no information at all (the pseudo-inverse), so it
/// cannot leak into the rig.
Matrix6 inverse_of(const Matrix6& information) {
  const Eigen::Matrix<double, 6, 1> scale =
      information.diagonal().cwiseMax(1e-12).cwiseSqrt().cwiseInverse();
  const Eigen::SelfAdjointEigenSolver<Matrix6> eigen(scale.asDiagonal() * information *
                                                     scale.asDiagonal());
  Eigen::Matrix<double, 6, 1> inverse = eigen.eigenvalues();
  for (double& value : inverse) value = value > 1e-14 ? 1.0 / value : 0.0;
  return scale.asDiagonal() * eigen.eigenvectors() * inverse.asDiagonal() *
         eigen.eigenvectors().transpose() * scale.asDiagonal();
}

}  // namespace

PerSighting<Eigen::Vector2d> whitened_residuals(const RigDescription& rig,
                                                const std::vector<TimedThrow>& throws,
                                                const Solution& at,
                                                const std::vector<double>& noise_scale) {
  PerSighting<Eigen::Vector2d> out(throws.size());
  for (std::size_t j = 0; j < throws.size(); ++j) {
    out[j].resize(throws[j].sightings.size());
    for_each_sighting(
        rig, throws[j], at, j,
        [&](std::size_t i, const TimedSighting& s, const auto& model, const auto&) {
          out[j][i] =
              model ? Eigen::Vector2d(s.whitening * model->residual_px / noise_scale[s.camera])
                    : Eigen::Vector2d::Constant(std::numeric_limits<double>::quiet_NaN());
        });
  }
  return out;
}

NormalEquations normal_equations(const RigDescription& rig, const std::vector<TimedThrow>& throws,
                                 const Solution& at, const Weighting& weighting, double damping) {
  const int size = slice::rig_size(at.rig.cameras()), drag = slice::drag(at.rig.cameras());
  NormalEquations out{Eigen::MatrixXd::Zero(size, size), Eigen::VectorXd::Zero(size), {}, 0.0, 0};
  Eigen::MatrixXd eliminated = Eigen::MatrixXd::Zero(size, size);
  Eigen::VectorXd eliminated_gradient = Eigen::VectorXd::Zero(size);
  out.balls.reserve(throws.size());
  for (std::size_t j = 0; j < throws.size(); ++j) {
    ThrowBlocks own;
    own.coupling.setZero(size, 6);
    for_each_sighting(
        rig, throws[j], at, j,
        [&](std::size_t i, const TimedSighting& s, const auto& model, const auto& ball) {
          if (!weighting.used[j][i]) return;
          ++out.sightings;
          if (!model) {
            out.cost += unseen_cost;
            return;
          }
          const Eigen::Matrix2d whitening = s.whitening / weighting.noise_scale[s.camera];
          const Huber robust =
              huber((whitening * model->residual_px).squaredNorm(), weighting.huber_sigmas);
          out.cost += robust.cost;
          add_sighting(out, own, s, *model, ball, std::sqrt(robust.weight) * whitening, drag);
        });
    own.ball.diagonal() *= 1 + damping;
    out.balls.push_back({inverse_of(own.ball), std::move(own.coupling), own.gradient});
    const NormalEquations::Ball& ball = out.balls.back();
    const Eigen::Matrix<double, Eigen::Dynamic, 6> weighted =
        ball.coupling * ball.inverse_information;
    eliminated.noalias() += weighted * ball.coupling.transpose();
    eliminated_gradient.noalias() += weighted * ball.gradient;
  }
  out.information.diagonal() *= 1 + damping;
  out.information -= eliminated;
  out.gradient -= eliminated_gradient;
  return out;
}

double cost(const RigDescription& rig, const std::vector<TimedThrow>& throws, const Solution& at,
            const Weighting& weighting) {
  double sum = 0.0;
  const auto residuals = whitened_residuals(rig, throws, at, weighting.noise_scale);
  for (std::size_t j = 0; j < residuals.size(); ++j)
    for (std::size_t i = 0; i < residuals[j].size(); ++i)
      if (weighting.used[j][i]) {
        const double squared = residuals[j][i].squaredNorm();
        sum += std::isfinite(squared) ? huber(squared, weighting.huber_sigmas).cost : unseen_cost;
      }
  return sum;
}

}  // namespace throwcal
