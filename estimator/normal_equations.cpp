// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/normal_equations.h"

#include <Eigen/Dense>
#include <cmath>
#include <utility>

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

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
// Chosen at the program's start by what the processor has: a package must run on all of them.
#define FOR_WIDE_REGISTERS_TOO __attribute__((target_clones("avx2", "default")))
#else
#define FOR_WIDE_REGISTERS_TOO
#endif

/// One sighting and what it counts, for the sum of its camera.
struct Weighed {
  const double* rows;
  double weight;
  double* sum;
};

/// Adds weight (a a^T + b b^T) of each sighting's two rows to its camera's sum (columns x columns,
/// row by row), at and below the diagonal. Plain rows are three registers of four: where one meets
/// its end within a register, all of that is added, for what lies beyond the diagonal does not
/// matter.
FOR_WIDE_REGISTERS_TOO void add_products(const std::vector<Weighed>& sightings, int columns) {
  using Four = double __attribute__((vector_size(32), aligned(8), may_alias));
  for (const Weighed& s : sightings) {
    const double *a = s.rows, *b = s.rows + columns;
    if (columns == Linearisation::plain_columns) {
      const auto *a4 = reinterpret_cast<const Four*>(a), *b4 = reinterpret_cast<const Four*>(b);
      const Four a0 = a4[0], a1 = a4[1], a2 = a4[2], b0 = b4[0], b1 = b4[1], b2 = b4[2];
      auto* out = reinterpret_cast<Four*>(s.sum);
      for (int i = 0; i < Linearisation::plain_columns; ++i, out += 3) {
        const double wa = s.weight * a[i], wb = s.weight * b[i];
        out[0] += wa * a0 + wb * b0;
        if (i > 3) out[1] += wa * a1 + wb * b1;
        if (i > 7) out[2] += wa * a2 + wb * b2;
      }
    } else {
      for (int i = 0; i < columns; ++i) {
        const double wa = s.weight * a[i], wb = s.weight * b[i];
        double* out = s.sum + i * columns;
        for (int j = 0; j <= i; ++j) out[j] += wa * a[j] + wb * b[j];
      }
    }
  }
}

/// Which of a sum's columns a number of a camera's slice is.
struct Slot {
  int column;
  double sign = 1.0;
};

std::vector<Slot> slots_of(const RigLayout::Camera& camera, std::size_t k) {
  std::vector<Slot> out;
  if (camera.size == 0) return out;  // not placed
  if (k > 0)                         // only where the ball is from the camera matters
    for (int i = 0; i < 3; ++i) out.push_back({Linearisation::position + i, -1.0});
  for (int i = 0; i < (k == 0 ? 2 : 3); ++i) out.push_back({Linearisation::rotation + i});
  if (camera.offset) out.push_back({Linearisation::offset});
  for (std::size_t n = 0; n < camera.intrinsics.size(); ++n)
    out.push_back({Linearisation::lens + static_cast<int>(n)});
  return out;
}

/// Camera 1's two turns in the place of its rotation's first two columns.
void mix_turns(const Eigen::Matrix<double, 3, 2>& turns, Eigen::MatrixXd& sum) {
  for (int c = 0; c < sum.cols(); ++c) {
    auto rows = sum.col(c).segment<3>(Linearisation::rotation);
    const Eigen::Vector2d mixed = turns.transpose() * rows;
    rows.head<2>() = mixed;
  }
  for (int r = 0; r < sum.rows(); ++r) {
    auto columns = sum.row(r).segment<3>(Linearisation::rotation);
    const Eigen::RowVector2d mixed = columns * turns;
    columns.head<2>() = mixed;
  }
}

/// Puts one camera's sum over one throw where the layout wants it.
void add_share(const Eigen::MatrixXd& sum, const RigLayout& layout, int start,
               const std::vector<Slot>& slots, NormalEquations& out, NormalEquations::Ball& ball) {
  constexpr int ball_size = RigLayout::ball_size, residual = Linearisation::residual;
  const int size = static_cast<int>(slots.size());
  for (int a = 0; a < size; ++a) {
    const auto [column, sign] = slots[a];
    for (int b = 0; b < size; ++b)
      out.information(start + b, start + a) += sign * slots[b].sign * sum(slots[b].column, column);
    out.gradient[start + a] += sign * sum(residual, column);
    for (int c = 0; c < ball_size; ++c) ball.coupling(start + a, c) += sign * sum(c, column);
  }
  ball.information += sum.topLeftCorner<ball_size, ball_size>();
  ball.gradient += sum.col(residual).head<ball_size>();
  if (!layout.drag()) return;
  const int drag = *layout.drag();
  const auto of_drag = sum.col(Linearisation::drag);
  for (int a = 0; a < size; ++a) {
    const double value = slots[a].sign * of_drag[slots[a].column];
    out.information(drag, start + a) += value;
    out.information(start + a, drag) += value;
  }
  out.information(drag, drag) += of_drag[Linearisation::drag];
  out.gradient[drag] += of_drag[residual];
  ball.coupling.row(drag) += of_drag.head<ball_size>().transpose();
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

double cost(const std::vector<TimedThrow>& throws, const PerSighting<Eigen::Vector2d>& residuals,
            const Weighting& weighting) {
  std::vector<double> inverse;  // of the noise's variance
  for (double scale : weighting.noise_scale) inverse.push_back(1.0 / (scale * scale));
  double sum = 0.0;
  for (std::size_t j = 0; j < residuals.size(); ++j) {
    const TimedSighting* s = throws[j].sightings.data();
    const char* used = weighting.used[j].data();
    for (const Eigen::Vector2d& residual : residuals[j]) {
      const double squared = residual.squaredNorm() * inverse[s++->camera];
      if (!*used++) continue;
      sum += std::isfinite(squared) ? huber(squared, weighting.huber_sigmas).cost : unseen_cost;
    }
  }
  return sum;
}

NormalEquations normal_equations(const std::vector<TimedThrow>& throws, const Linearisation& linear,
                                 const RigState& rig, const RigLayout& layout,
                                 const Weighting& weighting) {
  const std::size_t cameras = rig.cameras();
  const int size = layout.size(), columns = linear.columns;
  NormalEquations out{Eigen::MatrixXd::Zero(size, size), Eigen::VectorXd::Zero(size),
                      std::vector<NormalEquations::Ball>(throws.size())};
  const Eigen::Matrix<double, 3, 2> turns = camera_one_turns(rig.T_world_cam[0]);
  std::vector<std::vector<Slot>> slots;
  for (std::size_t k = 0; k < cameras; ++k) slots.push_back(slots_of(layout.camera(k), k));
  // Column by column where add_products() counts row by row: the upper triangle.
  std::vector<Eigen::MatrixXd> sums(cameras, Eigen::MatrixXd(columns, columns));
  std::vector<char> takes_part(cameras);
  std::vector<Weighed> weighed;
  for (std::size_t j = 0; j < throws.size(); ++j) {
    takes_part.assign(cameras, false);
    weighed.clear();
    for (std::size_t i = 0; i < throws[j].sightings.size(); ++i) {
      const double* rows = linear.row(j, i);
      const Eigen::Vector2d residual(rows[Linearisation::residual],
                                     rows[columns + Linearisation::residual]);
      if (!weighting.used[j][i] || !residual.allFinite()) continue;
      const CameraId k = throws[j].sightings[i].camera;
      const double scale2 = weighting.noise_scale[k] * weighting.noise_scale[k];
      const double weight =
          huber(residual.squaredNorm() / scale2, weighting.huber_sigmas).weight / scale2;
      if (!std::exchange(takes_part[k], true)) sums[k].setZero();
      weighed.push_back({rows, weight, sums[k].data()});
    }
    add_products(weighed, columns);
    out.balls[j].coupling.setZero(size, RigLayout::ball_size);
    for (std::size_t k = 0; k < cameras; ++k) {
      if (!takes_part[k]) continue;
      sums[k].triangularView<Eigen::StrictlyLower>() = sums[k].transpose();
      if (k == 0) mix_turns(turns, sums[k]);
      add_share(sums[k], layout, layout.camera(k).start, slots[k], out, out.balls[j]);
    }
  }
  return out;
}

NormalEquations normal_equations(const RigDescription& rig, const std::vector<TimedThrow>& throws,
                                 const Solution& at, const RigLayout& layout,
                                 const Weighting& weighting) {
  Linearisation linear;
  linearise(rig, throws, at, linear);
  return normal_equations(throws, linear, at.rig, layout, weighting);
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

Eigen::VectorXd gradient_of_shift(const std::vector<TimedThrow>& throws,
                                  const Linearisation& linear, const RigState& rig,
                                  const RigLayout& layout, const Weighting& weighting,
                                  const NormalEquations& normal, const ReducedEquations& reduced,
                                  CameraId camera, const Eigen::Vector2d& shift_px) {
  using Row = Eigen::Map<const Eigen::VectorXd>;
  const Eigen::Matrix<double, 3, 2> turns = camera_one_turns(rig.T_world_cam[0]);
  const std::vector<Slot> slots = slots_of(layout.camera(camera), camera);
  const int start = layout.camera(camera).start;
  const double scale = weighting.noise_scale[camera];
  Eigen::VectorXd out = Eigen::VectorXd::Zero(layout.size()), sum(linear.columns);
  for (std::size_t j = 0; j < throws.size(); ++j) {
    sum.setZero();
    for (std::size_t i = 0; i < throws[j].sightings.size(); ++i) {
      const TimedSighting& s = throws[j].sightings[i];
      const double* rows = linear.row(j, i);
      if (s.camera != camera || !weighting.used[j][i] ||
          !std::isfinite(rows[Linearisation::residual]))
        continue;
      const Eigen::Vector2d moved = s.whitening * shift_px / (scale * scale);
      sum += moved[0] * Row(rows, linear.columns) +
             moved[1] * Row(rows + linear.columns, linear.columns);
    }
    if (camera == 0) {
      auto rotation = sum.segment<3>(Linearisation::rotation);
      const Eigen::Vector2d mixed = turns.transpose() * rotation;
      rotation.head<2>() = mixed;
    }
    for (std::size_t a = 0; a < slots.size(); ++a)
      out[start + static_cast<int>(a)] += slots[a].sign * sum[slots[a].column];
    if (layout.drag()) out[*layout.drag()] += sum[Linearisation::drag];
    const Matrix6& root = reduced.ball_root[j];
    const NormalEquations::Vector6 ball =
        root * (root.transpose() * sum.head<RigLayout::ball_size>());
    out.noalias() -= normal.balls[j].coupling * ball;
  }
  return out;
}

}  // namespace throwcal
