// SPDX-License-Identifier: BSD-3-Clause
#include "tests/support/thesis_errors.h"

#include <Eigen/Dense>
#include <cmath>

#include "estimator/calibrate.h"
#include "estimator/throw_iteration.h"

namespace throwcal::test {
namespace {

/// Camera 2 turned about the ball's vertical until it stands at its true bearing from it.
ThesisPoses turned(const ThesisPoses& p, const Eigen::Vector3d& ball, const ThesisExperiment& e) {
  const Eigen::Vector3d arm = p.C2 - ball, true_arm = e.truth.tail<3>() - e.throws[0].truth.X;
  const Eigen::Matrix3d turn =
      exp_so3({0, std::atan2(true_arm.x(), true_arm.z()) - std::atan2(arm.x(), arm.z()), 0});
  return {p.R1, p.R2 * turn.transpose(), ball + turn * arm};
}

/// Rotation vectors of both cameras, then the centre.
Eigen::Vector<double, 9> pose_errors(const ThesisPoses& p, const ThesisExperiment& e) {
  const ThesisPoses truth = thesis_poses(e.truth);
  Eigen::Vector<double, 9> out;
  out << log_so3(p.R1 * truth.R1.transpose()), log_so3(p.R2 * truth.R2.transpose()),
      p.C2 - truth.C2;
  return out;
}

constexpr int zxz_rows = 5, pose_rows = 9, error_rows = zxz_rows + 2 * pose_rows;

/// All that ThesisErrors are norms of: z-x-z angles, pose errors, pose errors when turned.
Eigen::Vector<double, error_rows> error_vector(const ThesisPoses& p, const Eigen::Vector3d& ball,
                                               const ThesisExperiment& e) {
  Eigen::Vector<double, error_rows> out;
  out << (thesis_cameras(p) - e.truth).head<zxz_rows>(), pose_errors(p, e),
      pose_errors(turned(p, ball, e), e);
  return out;
}

template <typename Norm>
ThesisErrors norms(Norm norm) {
  const int pose = zxz_rows, turned_pose = zxz_rows + pose_rows;
  return {norm(0, zxz_rows),        norm(pose, 6),
          norm(pose + 6, 3),        norm(turned_pose, 6),
          norm(turned_pose + 6, 3), {}};
}

ThesisErrors pose_errors_of(const ThesisExperiment& e, const ThesisEstimate& at) {
  const auto error = error_vector(at.poses, at.balls[0].X, e);
  return norms([&](int row, int rows) { return error.segment(row, rows).norm(); });
}

std::array<double, 2> reprojection_px(const ThesisExperiment& e, const ThesisRecording& recording,
                                      const ThesisEstimate& at) {
  std::array<double, 2> sum{}, count{};
  for (std::size_t j = 0; j < recording.throws.size(); ++j)
    for (const Track& track : recording.throws[j].tracks)
      for (const BallSighting& s : track.sightings) {
        const double time_s = seconds(s.time - first_frame(j));
        const auto seen = sight_of(e, at.poses, flown(at.balls[j], time_s))[track.camera];
        sum[track.camera] +=
            seen ? (*seen - s.center_px).norm() : std::numeric_limits<double>::infinity();
        ++count[track.camera];
      }
  return {sum[0] / count[0], sum[1] / count[1]};
}

/// `solve` makes an estimate of a recording, or nothing.
template <typename Solve>
ThesisErrors rms_errors(const ThesisExperiment& e, int seeds, Solve solve) {
  ThesisErrors sum;
  int count = 0;
  const auto members = [](ThesisErrors& x) {
    return std::array{&x.zxz_rad,           &x.angle_rad,       &x.centre_m,
                      &x.turned_angle_rad,  &x.turned_centre_m, &x.reprojection_px[0],
                      &x.reprojection_px[1]};
  };
  for (int seed = 1; seed <= seeds; ++seed) {
    const ThesisRecording recording = record(e, static_cast<std::uint64_t>(seed));
    const std::optional<ThesisEstimate> at = solve(recording);
    if (!at) continue;
    ThesisErrors error = pose_errors_of(e, *at);
    error.reprojection_px = reprojection_px(e, recording, *at);
    for (std::size_t i = 0; i < members(sum).size(); ++i)
      *members(sum)[i] += std::pow(*members(error)[i], 2);
    ++count;
  }
  for (double* x : members(sum)) *x = std::sqrt(*x / count);
  return sum;
}

BallState at_first_frame(const BallState& ball, HostTime when, std::size_t j) {
  return fly(ball, seconds(first_frame(j) - when), {0, 0, -RigDescription{}.gravity_mps2}, 0.0);
}

/// The experiment's parameters about its truth: camera 1's two angles, camera 2's rotation vector
/// and centre, X and V of every ball.
struct Perturbed {
  ThesisPoses poses;
  std::vector<ThesisBall> balls;
};

Perturbed perturbed(const ThesisExperiment& e, const Eigen::VectorXd& by) {
  const ThesisPoses truth = thesis_poses(e.truth);
  Perturbed out{{turn_x(e.truth[1] + by[1]) * turn_z(e.truth[0] + by[0]),
                 exp_so3(by.segment<3>(2)) * truth.R2, truth.C2 + by.segment<3>(5)},
                {}};
  for (std::size_t j = 0; j < e.throws.size(); ++j) {
    const auto at = static_cast<Eigen::Index>(8 + 6 * j);
    out.balls.push_back(
        {e.throws[j].truth.X + by.segment<3>(at), e.throws[j].truth.V + by.segment<3>(at + 3)});
  }
  return out;
}

/// Central differences of a function of `size` parameters at zero.
template <typename Function>
Eigen::MatrixXd derivative(Eigen::Index size, Function function) {
  constexpr double step = 1e-5;  // rounding and curvature both stay below 1e-6 of a derivative
  Eigen::MatrixXd out;
  for (Eigen::Index i = 0; i < size; ++i) {
    const Eigen::VectorXd by = step * Eigen::VectorXd::Unit(size, i);
    const Eigen::VectorXd column = (function(by) - function(-by)) / (2 * step);
    if (i == 0) out.resize(column.size(), size);
    out.col(i) = column;
  }
  return out;
}

/// Of an information matrix; without its weakest direction where a drop leaves one undetermined.
Eigen::MatrixXd inverse(const Eigen::MatrixXd& information, bool is_drop) {
  const Eigen::VectorXd scale = information.diagonal().cwiseSqrt().cwiseInverse();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(scale.asDiagonal() * information *
                                                             scale.asDiagonal());
  Eigen::VectorXd values = eigen.eigenvalues().cwiseInverse();
  if (is_drop) values[0] = 0.0;
  const Eigen::MatrixXd vectors = scale.asDiagonal() * eigen.eigenvectors();
  return vectors * values.asDiagonal() * vectors.transpose();
}

/// Sums over all frames of J^T N^-1 J, J^T J and J^T N J, with J the derivative of a frame's pixels
/// and N their noise.
struct Information {
  Eigen::MatrixXd fisher, normal, noisy_normal;
};

Information information_of(const ThesisExperiment& e) {
  const auto size = static_cast<Eigen::Index>(8 + 6 * e.throws.size());
  const Eigen::VectorXd here = Eigen::VectorXd::Zero(size);
  const Eigen::MatrixXd zero = Eigen::MatrixXd::Zero(size, size);
  Information out{zero, zero, zero};
  for (std::size_t j = 0; j < e.throws.size(); ++j)
    for (const SeenFrame& frame : seen_frames(e, e.throws[j])) {
      const auto pixels = [&](const Perturbed& at, const Eigen::Vector3d& disturbance) {
        const Sight sight = sight_of(e, at.poses, flown(at.balls[j], frame.time_s) + disturbance);
        Eigen::Vector4d seen = Eigen::Vector4d::Zero();
        if (frame.by[0]) seen.head<2>() = *sight[0];
        if (frame.by[1]) seen.tail<2>() = *sight[1];
        return seen;
      };
      const Eigen::MatrixXd J = derivative(size, [&](const Eigen::VectorXd& by) {
        return pixels(perturbed(e, by), Eigen::Vector3d::Zero());
      });
      const Eigen::MatrixXd J_ball =
          derivative(3, [&](const Eigen::VectorXd& by) { return pixels(perturbed(e, here), by); });
      const Eigen::Matrix4d noise = std::pow(e.sigma_px, 2) * Eigen::Matrix4d::Identity() +
                                    std::pow(e.sigma_ball_m, 2) * J_ball * J_ball.transpose();
      if (e.sigma_px > 0) out.fisher += J.transpose() * noise.inverse() * J;
      out.normal += J.transpose() * J, out.noisy_normal += J.transpose() * noise * J;
    }
  return out;
}

}  // namespace

ThesisErrors errors_of(const ThesisExperiment& e, const ThesisResult& result) {
  ThesisErrors out = pose_errors_of(e, {thesis_poses(result.cameras), {result.ball}});
  out.zxz_rad = (result.cameras - e.truth).head<zxz_rows>().norm();
  out.reprojection_px = result.reprojection_px;
  return out;
}

ThesisErrors filter_errors(const ThesisExperiment& e, const ThesisFilter& filter, int seeds) {
  return rms_errors(
      e, seeds, [&](const ThesisRecording& recording) -> std::optional<ThesisEstimate> {
        const auto timed = time_throws(recording.rig, recording.throws);
        Solution at =
            iterate_throws(recording.rig, timed, guessed_solution(e, recording.rig, timed),
                           filter.method, {.ekf = filter.ekf, .sweeps = filter.sweeps});
        for (std::size_t j = 0; j < timed.size(); ++j)
          at.balls[j] = at_first_frame(at.balls[j], timed[j].epoch, j);
        return thesis_estimate(at.rig.T_world_cam, at.balls);
      });
}

ThesisFull full_errors(const ThesisExperiment& e, int seeds) {
  ThesisFull out;
  const auto solve = [&](const ThesisRecording& recording) -> std::optional<ThesisEstimate> {
    const Calibration at = calibrate(recording.rig, recording.throws);
    out.accepted += at.verdict == Verdict::accepted;
    out.unobservable += at.verdict == Verdict::unobservable;
    if (at.verdict == Verdict::unobservable) return std::nullopt;
    std::vector<BallState> balls(recording.throws.size());
    for (const ThrowEstimate& ball : at.throws) {
      const std::size_t j = std::stoul(ball.id) - 1;
      balls[j] = at_first_frame({ball.position_world_m, ball.velocity_world_mps}, ball.start, j);
    }
    return thesis_estimate({*at.cameras[0].T_world_cam, *at.cameras[1].T_world_cam}, balls);
  };
  out.errors = rms_errors(e, seeds, solve);
  return out;
}

ThesisErrors truth_errors(const ThesisExperiment& e, int seeds) {
  return rms_errors(e, seeds, [&](const ThesisRecording&) -> std::optional<ThesisEstimate> {
    ThesisEstimate truth{thesis_poses(e.truth), {}};
    for (const ThesisThrow& thrown : e.throws) truth.balls.push_back(thrown.truth);
    return truth;
  });
}

ThesisBounds bounds_of(const ThesisExperiment& e) {
  const Information information = information_of(e);
  const Eigen::Index size = information.normal.rows();
  const Eigen::MatrixXd J = derivative(size, [&](const Eigen::VectorXd& by) {
    const Perturbed at = perturbed(e, by);
    return error_vector(at.poses, at.balls[0].X, e);
  });
  const auto expected = [&](const Eigen::MatrixXd& covariance) {
    ThesisErrors out = norms([&](int row, int rows) {
      const auto J_rows = J.middleRows(row, rows);
      return std::sqrt((J_rows * covariance * J_rows.transpose()).trace());
    });
    if (e.is_drop) out.angle_rad = out.centre_m = std::numeric_limits<double>::infinity();
    return out;
  };
  if (!(e.sigma_px > 0)) {
    const ThesisErrors none = expected(Eigen::MatrixXd::Zero(size, size));
    return {none, none};
  }
  const Eigen::MatrixXd solve = inverse(information.normal, e.is_drop);
  return {expected(inverse(information.fisher, e.is_drop)),
          expected(solve * information.noisy_normal * solve)};
}

}  // namespace throwcal::test
