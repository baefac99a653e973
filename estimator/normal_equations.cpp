// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/normal_equations.h"

#include <Eigen/Dense>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "estimator/flight_path.h"

namespace throwcal {
namespace {

using Matrix6 = NormalEquations::Matrix6;
constexpr double unseen_cost =
    1e6;  // a sighting whose ball cannot be seen: 1000 sigma, so that no step gains by it
constexpr double well_conditioned = 1e-12;  // reciprocal condition of a scaled ball's information

/// Huber's cost and weight of a squared distance.
struct Huber {
  double cost, weight;
};
Huber huber(double squared, double limit) {
  if (limit <= 0.0 || squared <= limit * limit) return {squared, 1.0};
  const double distance = std::sqrt(squared);
  return {2 * limit * distance - limit * limit, limit / distance};
}

/// What the sightings of one camera say in one throw: the sum of the outer products of their two
/// rows [position 3 | velocity 3 | rotation 3 | offset | drag | residual | lens numbers]. Every
/// parameter of the ball and the camera is one of these columns or a fixed mixture of them, so the
/// layout comes in once a throw, not once a sighting.
class CameraShare {
 public:
  static constexpr int position = 0, velocity = 3, rotation = 6, offset = 9, drag = 10,
                       residual = 11, lens = 12;
  static constexpr int plain = 12, width = lens + intrinsics + 1;  // even: whole vector registers
  using Sum = Eigen::Matrix<double, width, width, Eigen::RowMajor>;

  void clear(int lens_numbers) {
    columns_ = plain + lens_numbers;
    sum_.topRows(columns_).setZero();
    row_[0].fill(0.0), row_[1].fill(0.0);
  }

  void add(const SightingModel& model, const Propagation& ball, const Eigen::Matrix2d& whitening,
           const std::vector<Intrinsic>& estimated) {
    const Eigen::Matrix<double, 2, 3> J_velocity =
        model.J_position.lazyProduct(ball.J_position_velocity0);
    const Eigen::Vector2d J_drag = model.J_position.lazyProduct(ball.J_position_drag);
    for (int i = 0; i < 2; ++i) {
      double* row = row_[i].data();
      const auto whiten = [&](const auto& J, int c) {
        return whitening(i, 0) * J(0, c) + whitening(i, 1) * J(1, c);
      };
      for (int c = 0; c < 3; ++c) {
        row[position + c] = whiten(model.J_position, c);
        row[velocity + c] = whiten(J_velocity, c);
        row[rotation + c] = whiten(model.J_rotation, c);
      }
      row[offset] = whiten(model.J_offset, 0);
      row[drag] = whiten(J_drag, 0);
      row[residual] = whiten(model.residual_px, 0);
      for (std::size_t n = 0; n < estimated.size(); ++n)
        row[lens + n] = whiten(model.J_lens, static_cast<int>(estimated[n]));
    }
    if (columns_ == plain)
      add_products<plain>(plain);
    else
      add_products<0>(columns_);
  }

  /// Both triangles.
  Eigen::MatrixXd matrix() const {
    return Eigen::MatrixXd(sum_.topLeftCorner(columns_, columns_).selfadjointView<Eigen::Lower>());
  }

 private:
  template <int fixed>
  void add_products(int columns) {
    const double *a = row_[0].data(), *b = row_[1].data();
    for (int i = 0; i < (fixed ? fixed : columns); ++i) {
      double* out = sum_.data() + i * width;
      const int whole = (i | 1) + 1;  // one beyond the diagonal does not matter
      for (int j = 0; j < whole; ++j) out[j] += a[i] * a[j] + b[i] * b[j];
    }
  }

  Sum sum_;
  std::array<double, width> row_[2];
  int columns_ = plain;
};

/// Which mixture of a CameraShare's columns each number of a camera's slice is (slice's size x
/// columns).
Eigen::MatrixXd mixture_of(const RigLayout::Camera& camera, std::size_t k,
                           const Eigen::Matrix<double, 3, 2>& turns) {
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(
      camera.size, CameraShare::plain + static_cast<int>(camera.intrinsics.size()));
  if (camera.size == 0) return out;  // not placed
  if (k == 0) {
    out.block<2, 3>(0, CameraShare::rotation) = turns.transpose();
  } else {
    // Only where the ball is from the camera matters.
    out.block<3, 3>(0, CameraShare::position) = -Eigen::Matrix3d::Identity();
    out.block<3, 3>(3, CameraShare::rotation).setIdentity();
  }
  if (camera.offset) out(*camera.offset, CameraShare::offset) = 1.0;
  for (std::size_t n = 0; n < camera.intrinsics.size(); ++n)
    out(camera.lens + n, CameraShare::lens + n) = 1.0;
  return out;
}

/// Puts one camera's share of one throw where the layout wants it.
void add_share(const CameraShare& share, const RigLayout& layout, const RigLayout::Camera& camera,
               const Eigen::MatrixXd& mixture, NormalEquations& out, NormalEquations::Ball& ball) {
  constexpr int ball_size = RigLayout::ball_size;
  const Eigen::MatrixXd sum = share.matrix(), mixed = mixture * sum;
  const int at = camera.start, size = camera.size;
  out.information.block(at, at, size, size).noalias() += mixed * mixture.transpose();
  out.gradient.segment(at, size) += mixed.col(CameraShare::residual);
  ball.coupling.middleRows(at, size) += mixed.leftCols<ball_size>();
  ball.information += sum.topLeftCorner<ball_size, ball_size>();
  ball.gradient += sum.col(CameraShare::residual).head<ball_size>();
  if (!layout.drag()) return;
  const int drag = *layout.drag();
  const auto column = mixed.col(CameraShare::drag);
  out.information.col(drag).segment(at, size) += column;
  out.information.row(drag).segment(at, size) += column.transpose();
  out.information(drag, drag) += sum(CameraShare::drag, CameraShare::drag);
  out.gradient[drag] += sum(CameraShare::drag, CameraShare::residual);
  ball.coupling.row(drag) += sum.row(CameraShare::drag).head<ball_size>();
}

/// R with R R^T the inverse of a ball's information; scaled first, for metres and metres per second
/// differ. A direction that no sighting determines gets no information at all (the pseudo-inverse),
/// so it cannot leak into the rig.
Matrix6 inverse_root(const Matrix6& information) {
  const NormalEquations::Vector6 scale =
      information.diagonal().cwiseMax(1e-12).cwiseSqrt().cwiseInverse();
  const Matrix6 scaled = scale.asDiagonal() * information * scale.asDiagonal();
  const Eigen::LLT<Matrix6> llt(scaled);
  if (llt.info() == Eigen::Success && llt.rcond() > well_conditioned) {
    Matrix6 root = Matrix6::Identity();
    llt.matrixU().solveInPlace(root);
    return scale.asDiagonal() * root;
  }
  const Eigen::SelfAdjointEigenSolver<Matrix6> eigen(scaled);
  NormalEquations::Vector6 inverse = eigen.eigenvalues();
  for (double& value : inverse) value = value > 1e-14 ? 1.0 / std::sqrt(value) : 0.0;
  return scale.asDiagonal() * eigen.eigenvectors() * inverse.asDiagonal();
}

}  // namespace

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

double cost(const std::vector<TimedThrow>& throws, const PerSighting<Eigen::Vector2d>& residuals,
            const Weighting& weighting) {
  double sum = 0.0;
  for (std::size_t j = 0; j < residuals.size(); ++j)
    for (std::size_t i = 0; i < residuals[j].size(); ++i) {
      if (!weighting.used[j][i]) continue;
      const double scale = weighting.noise_scale[throws[j].sightings[i].camera];
      const double squared = residuals[j][i].squaredNorm() / (scale * scale);
      sum += std::isfinite(squared) ? huber(squared, weighting.huber_sigmas).cost : unseen_cost;
    }
  return sum;
}

NormalEquations normal_equations(const RigDescription& rig, const std::vector<TimedThrow>& throws,
                                 const Solution& at, const RigLayout& layout,
                                 const Weighting& weighting) {
  const std::size_t cameras = at.rig.cameras();
  const int size = layout.size();
  NormalEquations out{Eigen::MatrixXd::Zero(size, size), Eigen::VectorXd::Zero(size),
                      std::vector<NormalEquations::Ball>(throws.size())};
  const Eigen::Matrix<double, 3, 2> turns = camera_one_turns(at.rig.T_world_cam[0]);
  std::vector<Eigen::MatrixXd> mixtures;
  for (std::size_t k = 0; k < cameras; ++k)
    mixtures.push_back(mixture_of(layout.camera(k), k, turns));
  std::vector<CameraShare> shares(cameras);
  std::vector<char> takes_part(cameras);
  SightingModel model;
  for (std::size_t j = 0; j < throws.size(); ++j) {
    takes_part.assign(cameras, false);
    FlightPath path(at.balls[j], {0, 0, -rig.gravity_mps2}, at.rig.drag_per_m,
                    FlightPath::Wants::sensitivities, rig.ball.estimate_drag);
    for (std::size_t i = 0; i < throws[j].sightings.size(); ++i) {
      if (!weighting.used[j][i]) continue;
      const TimedSighting& s = throws[j].sightings[i];
      const std::vector<Intrinsic>& lens = layout.camera(s.camera).intrinsics;
      const Propagation& ball = path.at(moment_s(at.rig, s));
      if (!model_sighting(at.rig, ball.state, s, !lens.empty(), model)) continue;
      Eigen::Matrix2d whitening = s.whitening / weighting.noise_scale[s.camera];
      if (weighting.huber_sigmas > 0)
        whitening *= std::sqrt(
            huber((whitening * model.residual_px).squaredNorm(), weighting.huber_sigmas).weight);
      if (!std::exchange(takes_part[s.camera], true))
        shares[s.camera].clear(static_cast<int>(lens.size()));
      shares[s.camera].add(model, ball, whitening, lens);
    }
    out.balls[j].coupling.setZero(size, RigLayout::ball_size);
    for (std::size_t k = 0; k < cameras; ++k)
      if (takes_part[k])
        add_share(shares[k], layout, layout.camera(k), mixtures[k], out, out.balls[j]);
  }
  return out;
}

ReducedEquations eliminate_balls(const NormalEquations& normal, double damping) {
  ReducedEquations out{normal.information, normal.gradient, {}};
  out.information.diagonal() *= 1 + damping;
  for (const NormalEquations::Ball& ball : normal.balls) {
    Matrix6 damped = ball.information;
    damped.diagonal() *= 1 + damping;
    out.ball_root.push_back(inverse_root(damped));
    const Eigen::Matrix<double, Eigen::Dynamic, 6> coupling =
        ball.coupling.lazyProduct(out.ball_root.back());
    out.information.selfadjointView<Eigen::Lower>().rankUpdate(coupling, -1.0);
    out.gradient.noalias() -= coupling * (out.ball_root.back().transpose() * ball.gradient);
  }
  out.information.triangularView<Eigen::StrictlyUpper>() = out.information.transpose();
  return out;
}

NormalEquations::Vector6 ReducedEquations::ball_step(const NormalEquations& normal,
                                                     std::size_t ball,
                                                     const Eigen::VectorXd& rig_step) const {
  const NormalEquations::Ball& of = normal.balls[ball];
  return ball_root[ball] *
         (ball_root[ball].transpose() * (of.gradient - of.coupling.transpose() * rig_step));
}

}  // namespace throwcal
