// SPDX-License-Identifier: BSD-3-Clause
#include "tests/bench/ceres_rival.h"

#include <array>
#include <cassert>

#include "estimator/flight_path.h"

namespace throwcal::bench {
namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
constexpr int ball_size = RigLayout::ball_size;
constexpr int pose_numbers = 12;  // rotation matrix by columns, translation

using PoseBlock = std::array<double, pose_numbers>;
Eigen::Map<Eigen::Matrix3d> rotation(double* block) { return Eigen::Map<Eigen::Matrix3d>(block); }
Eigen::Map<const Eigen::Matrix3d> rotation(const double* block) {
  return Eigen::Map<const Eigen::Matrix3d>(block);
}

/// A pose with this project's perturbation. The cost functions write their derivatives by the
/// perturbation into the first columns, so that the chain rule is a product with [I; 0].
template <int tangent>
class PoseManifold : public ceres::Manifold {
 public:
  int AmbientSize() const override { return pose_numbers; }
  int TangentSize() const override { return tangent; }
  bool Plus(const double* x, const double* step, double* out) const override {
    Eigen::Map<Eigen::Vector3d> to(out + 9);
    to = Eigen::Map<const Eigen::Vector3d>(x + 9);
    if constexpr (tangent == 2) {
      rotation(out) = exp_so3({0, step[0], 0}) * rotation(x) * exp_so3({0, 0, step[1]});
    } else {
      to += Eigen::Map<const Eigen::Vector3d>(step);
      rotation(out) = exp_so3(Eigen::Map<const Eigen::Vector3d>(step + 3)) * rotation(x);
    }
    return true;
  }
  bool PlusJacobian(const double*, double* J) const override {
    Eigen::Map<Eigen::Matrix<double, pose_numbers, tangent, Eigen::RowMajor>>(J).setIdentity();
    return true;
  }
  bool Minus(const double*, const double*, double*) const override { return false; }
  bool MinusJacobian(const double*, double*) const override { return false; }
};

}  // namespace

/// The parameters, and what all cost functions read: unfolded once an evaluation.
class CeresRival::Shared : public ceres::EvaluationCallback {
 public:
  Shared(const RigDescription& rig, const std::vector<TimedThrow>& throws, const Solution& start)
      : rig_(rig), throws_(throws), state_(start.rig), layout_(rig, start.rig) {
    poses_.resize(state_.cameras());
    balls_.resize(throws.size());
    is_parabola_ = !rig.ball.estimate_drag && start.rig.drag_per_m == 0.0;
    for (const TimedThrow& thrown : throws) flights_.emplace_back(thrown.sightings.size());
    set(start);
  }

  void set(const Solution& at) {
    state_ = at.rig;
    for (std::size_t k = 0; k < poses_.size(); ++k) {
      rotation(poses_[k].data()) = at.rig.T_world_cam[k].rotation;
      Eigen::Map<Eigen::Vector3d>(poses_[k].data() + 9) = at.rig.T_world_cam[k].translation;
    }
    for (std::size_t j = 0; j < balls_.size(); ++j)
      Eigen::Map<Eigen::Matrix<double, ball_size, 1>>(balls_[j].data()) << at.balls[j].position_m,
          at.balls[j].velocity_mps;
    unfold();
  }

  void PrepareForEvaluation(bool wants_jacobians, bool is_new) override {
    if (is_new) unfold();
    if (!is_new && (!wants_jacobians || has_jacobians_)) return;
    has_jacobians_ = wants_jacobians;
    if (is_parabola_) return;  // cheaper anew at each sighting than fetched from memory
    for (std::size_t j = 0; j < throws_.size(); ++j) {
      const auto& sightings = throws_[j].sightings;
      if (wants_jacobians) {
        FlightPath path(ball(j), gravity(), state_.drag_per_m, FlightPath::Wants::sensitivities,
                        true);
        for (std::size_t i = 0; i < sightings.size(); ++i)
          flights_[j][i] = path.at(moment_s(state_, sightings[i]));
        continue;
      }
      FlightPath path(ball(j), gravity(), state_.drag_per_m, FlightPath::Wants::state, false);
      for (std::size_t i = 0; i < sightings.size(); ++i)
        flights_[j][i].state = path.at(moment_s(state_, sightings[i])).state;
    }
  }

  BallState ball(std::size_t j) const {
    const double* b = balls_[j].data();
    return {{b[0], b[1], b[2]}, {b[3], b[4], b[5]}};
  }
  Eigen::Vector3d gravity() const { return {0, 0, -rig_.gravity_mps2}; }

  const RigDescription& rig_;
  const std::vector<TimedThrow>& throws_;
  RigState state_;  // offsets and drag are parameter blocks themselves, poses are unfolded
  RigLayout layout_;
  Eigen::Matrix<double, 3, 2> turns_;
  std::vector<PoseBlock> poses_;
  std::vector<std::array<double, ball_size>> balls_;
  std::vector<std::vector<Propagation>> flights_;
  bool is_parabola_ = false, has_jacobians_ = false;

 private:
  void unfold() {
    for (std::size_t k = 0; k < poses_.size(); ++k)
      state_.T_world_cam[k] = {rotation(poses_[k].data()),
                               Eigen::Map<const Eigen::Vector3d>(poses_[k].data() + 9)};
    turns_ = camera_one_turns(state_.T_world_cam[0]);
  }
};

namespace {

/// Parameter blocks: ball, pose, then the offset and the drag where they are estimated.
template <typename Shared, int... sizes>
class SightingCost : public ceres::SizedCostFunction<2, ball_size, pose_numbers, sizes...> {
 public:
  SightingCost(const Shared& shared, std::size_t j, std::size_t i, bool has_offset, bool has_drag)
      : shared_(shared), throw_(j), index_(i), has_offset_(has_offset), has_drag_(has_drag) {}

  bool Evaluate(double const* const*, double* residuals, double** jacobians) const override {
    const TimedSighting& s = shared_.throws_[throw_].sightings[index_];
    double velocity_time_s = 0.0;
    BallState ball;
    if (shared_.is_parabola_) {
      velocity_time_s = moment_s(shared_.state_, s);
      ball = fly(shared_.ball(throw_), velocity_time_s, shared_.gravity(), 0.0);
    } else {
      ball = shared_.flights_[throw_][index_].state;
    }
    Eigen::Map<Eigen::Vector2d> out(residuals);
    if (!jacobians) {
      const auto residual = residual_px(shared_.state_, ball, s);
      if (!residual) return false;
      out = s.whitening * *residual;
      return true;
    }
    SightingModel model;
    if (!model_sighting(shared_.state_, ball, s, false, true, model)) return false;
    out = model.residual_px;
    const Eigen::Matrix<double, 2, 3> J_position = -model.J_position;  // measured minus predicted
    if (double* block = jacobians[0]) {
      Eigen::Map<Eigen::Matrix<double, 2, ball_size, Eigen::RowMajor>> J(block);
      J.leftCols<3>() = J_position;
      if (shared_.is_parabola_)
        J.rightCols<3>() = velocity_time_s * J_position;
      else
        J.rightCols<3>() =
            J_position.lazyProduct(shared_.flights_[throw_][index_].J_position_velocity0);
    }
    if (double* block = jacobians[1]) {
      Eigen::Map<Eigen::Matrix<double, 2, pose_numbers, Eigen::RowMajor>> J(block);
      J.setZero();
      const Eigen::Matrix<double, 2, 3> J_rotation = -model.J_rotation;
      if (s.camera == 0) {
        J.template leftCols<2>() = J_rotation.lazyProduct(shared_.turns_);
      } else {
        J.template leftCols<3>() = -J_position;
        J.template middleCols<3>(3) = J_rotation;
      }
    }
    int next = 2;
    if (has_offset_)
      if (double* block = jacobians[next++]) Eigen::Vector2d::Map(block) = -model.J_offset;
    if (has_drag_)
      if (double* block = jacobians[next])
        Eigen::Vector2d::Map(block) = J_position * shared_.flights_[throw_][index_].J_position_drag;
    return true;
  }

 private:
  const Shared& shared_;
  std::size_t throw_, index_;
  bool has_offset_, has_drag_;
};

}  // namespace

CeresRival::CeresRival(const RigDescription& rig, const std::vector<TimedThrow>& throws,
                       const Solution& start, const CeresChoice& choice)
    : shared_(std::make_unique<Shared>(rig, throws, start)), choice_(choice) {
  ceres::Problem::Options problem;
  problem.evaluation_callback = shared_.get();
  problem.disable_all_safety_checks = true;
  problem_ = std::make_unique<ceres::Problem>(problem);
  auto* order = new ceres::ParameterBlockOrdering;
  options_.linear_solver_ordering.reset(order);
  for (auto& ball : shared_->balls_) {
    problem_->AddParameterBlock(ball.data(), ball_size);
    order->AddElementToGroup(ball.data(), 0);
  }
  for (std::size_t k = 0; k < shared_->poses_.size(); ++k) {
    ceres::Manifold* manifold = new PoseManifold<6>;
    if (k == 0) delete std::exchange(manifold, new PoseManifold<2>);
    problem_->AddParameterBlock(shared_->poses_[k].data(), pose_numbers, manifold);
    order->AddElementToGroup(shared_->poses_[k].data(), 1);
    if (!shared_->layout_.camera(k).offset) continue;
    problem_->AddParameterBlock(&shared_->state_.time_offset_s[k], 1);
    order->AddElementToGroup(&shared_->state_.time_offset_s[k], 1);
  }
  double* const drag = shared_->layout_.drag() ? &shared_->state_.drag_per_m : nullptr;
  if (drag) {
    problem_->AddParameterBlock(drag, 1);
    order->AddElementToGroup(drag, 1);
  }
  for (std::size_t j = 0; j < throws.size(); ++j)
    for (std::size_t i = 0; i < throws[j].sightings.size(); ++i) {
      const CameraId k = throws[j].sightings[i].camera;
      double* const ball = shared_->balls_[j].data();
      double* const pose = shared_->poses_[k].data();
      double* const offset =
          shared_->layout_.camera(k).offset ? &shared_->state_.time_offset_s[k] : nullptr;
      if (offset && drag)
        problem_->AddResidualBlock(new SightingCost<Shared, 1, 1>(*shared_, j, i, true, true),
                                   nullptr, ball, pose, offset, drag);
      else if (offset || drag)
        problem_->AddResidualBlock(new SightingCost<Shared, 1>(*shared_, j, i, offset, drag),
                                   nullptr, ball, pose, offset ? offset : drag);
      else
        problem_->AddResidualBlock(new SightingCost<Shared>(*shared_, j, i, false, false), nullptr,
                                   ball, pose);
    }
  options_.linear_solver_type = choice.solver;
  options_.dense_linear_algebra_library_type = choice.dense;
  options_.sparse_linear_algebra_library_type = choice.sparse;
  options_.num_threads = choice.threads;
  options_.jacobi_scaling = choice.jacobi_scaling;
  options_.initial_trust_region_radius = choice.first_radius;
  options_.max_trust_region_radius = 1e32;
  options_.function_tolerance = choice.function_tolerance;
  options_.gradient_tolerance = options_.parameter_tolerance = 1e-16;
  options_.logging_type = ceres::SILENT;
}

CeresRival::~CeresRival() = default;

void CeresRival::set_start(const Solution& start) { shared_->set(start); }

ceres::Solver::Summary CeresRival::solve() {
  ceres::Solver::Summary summary;
  ceres::Solve(options_, problem_.get(), &summary);
  return summary;
}

Eigen::MatrixXd CeresRival::covariance() {
  ceres::Covariance::Options options;
  options.algorithm_type = choice_.covariance;
  options.sparse_linear_algebra_library_type = choice_.covariance_sparse;
  options.num_threads = choice_.threads;
  ceres::Covariance covariance(options);
  std::vector<const double*> blocks;
  for (std::size_t k = 0; k < shared_->poses_.size(); ++k) {
    blocks.push_back(shared_->poses_[k].data());
    if (shared_->layout_.camera(k).offset) blocks.push_back(&shared_->state_.time_offset_s[k]);
  }
  if (shared_->layout_.drag()) blocks.push_back(&shared_->state_.drag_per_m);
  if (!covariance.Compute(blocks, problem_.get())) return {};
  RowMajor out(shared_->layout_.size(), shared_->layout_.size());
  if (!covariance.GetCovarianceMatrixInTangentSpace(blocks, out.data())) return {};
  return out;
}

Solution CeresRival::solution() const {
  Solution out{shared_->state_, {}};
  for (std::size_t k = 0; k < shared_->poses_.size(); ++k) {
    const double* block = shared_->poses_[k].data();
    out.rig.T_world_cam[k] = {rotation(block), Eigen::Map<const Eigen::Vector3d>(block + 9)};
  }
  for (std::size_t j = 0; j < shared_->balls_.size(); ++j) out.balls.push_back(shared_->ball(j));
  return out;
}

double CeresRival::cost() const {
  double half = 0.0;
  ceres::Problem::EvaluateOptions options;
  problem_->Evaluate(options, &half, nullptr, nullptr, nullptr);
  return 2 * half;
}

}  // namespace throwcal::bench
