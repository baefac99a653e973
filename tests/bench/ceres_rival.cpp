// SPDX-License-Identifier: BSD-3-Clause
#include "tests/bench/ceres_rival.h"

#include <array>
#include <cmath>
#include <utility>

#include "estimator/linearisation.h"

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

/// The parameters, and the linearisation that all cost functions read: made once an evaluation.
class CeresRival::Shared : public ceres::EvaluationCallback {
 public:
  Shared(const RigDescription& rig, const std::vector<TimedThrow>& throws, const Solution& start)
      : rig_(rig), throws_(throws), layout_(rig, start.rig) {
    poses_.resize(start.rig.cameras());
    balls_.resize(throws.size());
    set(start);
  }

  void set(const Solution& at) {
    at_ = at;
    for (std::size_t k = 0; k < poses_.size(); ++k) {
      rotation(poses_[k].data()) = at.rig.T_world_cam[k].rotation;
      Eigen::Map<Eigen::Vector3d>(poses_[k].data() + 9) = at.rig.T_world_cam[k].translation;
    }
    for (std::size_t j = 0; j < balls_.size(); ++j)
      Eigen::Map<Eigen::Matrix<double, ball_size, 1>>(balls_[j].data()) << at.balls[j].position_m,
          at.balls[j].velocity_mps;
  }

  /// Ceres asks for a point's residuals first and, where it likes them, for its Jacobians then:
  /// both are made at once, as in our own descent.
  void PrepareForEvaluation(bool, bool is_new) override {
    if (!is_new && !linear_.rows.empty()) return;
    unfold();
    linearise(rig_, throws_, at_, linear_);
  }

  const Solution& unfold() {
    for (std::size_t k = 0; k < poses_.size(); ++k)
      at_.rig.T_world_cam[k] = {rotation(poses_[k].data()),
                                Eigen::Map<const Eigen::Vector3d>(poses_[k].data() + 9)};
    for (std::size_t j = 0; j < balls_.size(); ++j)
      at_.balls[j] = {Eigen::Map<const Eigen::Vector3d>(balls_[j].data()),
                      Eigen::Map<const Eigen::Vector3d>(balls_[j].data() + 3)};
    turns_ = camera_one_turns(at_.rig.T_world_cam[0]);
    return at_;
  }

  const RigDescription& rig_;
  const std::vector<TimedThrow>& throws_;
  RigLayout layout_;
  Solution at_;  // its offsets and its drag are parameter blocks themselves
  std::vector<PoseBlock> poses_;
  std::vector<std::array<double, ball_size>> balls_;
  Eigen::Matrix<double, 3, 2> turns_;
  Linearisation linear_;
};

namespace {

/// Parameter blocks: ball, pose, then the offset and the drag where they are estimated. All that is
/// left to do is to copy.
template <typename Shared, int... sizes>
class SightingCost : public ceres::SizedCostFunction<2, ball_size, pose_numbers, sizes...> {
 public:
  SightingCost(const Shared& shared, std::size_t j, std::size_t i, bool has_offset, bool has_drag)
      : shared_(shared),
        throw_(j),
        index_(i),
        is_first_(shared.throws_[j].sightings[i].camera == 0),
        has_offset_(has_offset),
        has_drag_(has_drag) {}

  bool Evaluate(double const* const*, double* residuals, double** jacobians) const override {
    using L = Linearisation;
    const double* row = shared_.linear_.row(throw_, index_);
    for (int i = 0; i < 2; ++i, row += shared_.linear_.columns) {
      residuals[i] = row[L::residual];
      if (!jacobians) continue;
      // Minus: the residual is measured minus predicted.
      if (jacobians[0])
        for (int c = 0; c < ball_size; ++c) jacobians[0][i * ball_size + c] = -row[c];
      if (double* pose = jacobians[1] ? jacobians[1] + i * pose_numbers : nullptr) {
        if (is_first_) {
          Eigen::RowVector2d::Map(pose) =
              -Eigen::RowVector3d::Map(row + L::rotation) * shared_.turns_;
          std::fill(pose + 2, pose + pose_numbers, 0.0);
        } else {
          for (int c = 0; c < 3; ++c)
            pose[c] = row[L::position + c], pose[3 + c] = -row[L::rotation + c];
          std::fill(pose + 6, pose + pose_numbers, 0.0);
        }
      }
      int next = 2;
      if (has_offset_)
        if (double* offset = jacobians[next++]) offset[i] = -row[L::offset];
      if (has_drag_ && jacobians[next]) jacobians[next][i] = -row[L::drag];
    }
    return std::isfinite(residuals[0]);
  }

 private:
  const Shared& shared_;
  std::size_t throw_, index_;
  bool is_first_, has_offset_, has_drag_;
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
    problem_->AddParameterBlock(&shared_->at_.rig.time_offset_s[k], 1);
    order->AddElementToGroup(&shared_->at_.rig.time_offset_s[k], 1);
  }
  double* const drag = shared_->layout_.drag() ? &shared_->at_.rig.drag_per_m : nullptr;
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
          shared_->layout_.camera(k).offset ? &shared_->at_.rig.time_offset_s[k] : nullptr;
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
    if (shared_->layout_.camera(k).offset) blocks.push_back(&shared_->at_.rig.time_offset_s[k]);
  }
  if (shared_->layout_.drag()) blocks.push_back(&shared_->at_.rig.drag_per_m);
  if (!covariance.Compute(blocks, problem_.get())) return {};
  RowMajor out(shared_->layout_.size(), shared_->layout_.size());
  if (!covariance.GetCovarianceMatrixInTangentSpace(blocks, out.data())) return {};
  return out;
}

Solution CeresRival::solution() const { return shared_->unfold(); }

double CeresRival::cost() const {
  double half = 0.0;
  ceres::Problem::EvaluateOptions options;
  problem_->Evaluate(options, &half, nullptr, nullptr, nullptr);
  return 2 * half;
}

}  // namespace throwcal::bench
