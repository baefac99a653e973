// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/observability.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "estimator/calibration.h"

namespace throwcal {
namespace {

// Beyond them the linearisation means nothing.
constexpr double wide_rotation_rad = 0.1, wide_position_m = 1.0;
constexpr double suspicious_rotation_rad = 0.005;  // smaller ones are not tried
constexpr double straight_down_mps = 0.2;          // across; a drop from a hand has a tenth of it
constexpr double share_of_direction = 1e-3;

/// The throws that a camera saw, by index.
std::vector<std::size_t> seen_by(CameraId camera, const std::vector<TimedThrow>& throws) {
  std::vector<std::size_t> out;
  for (std::size_t j = 0; j < throws.size(); ++j)
    if (std::any_of(throws[j].sightings.begin(), throws[j].sightings.end(),
                    [&](const TimedSighting& s) { return s.camera == camera; }))
      out.push_back(j);
  return out;
}

bool all_fell_straight_down(const std::vector<std::size_t>& throws, const Refinement& at) {
  return std::all_of(throws.begin(), throws.end(), [&](std::size_t j) {
    return at.solution.balls[j].velocity_mps.head<2>().norm() < straight_down_mps;
  });
}

/// Why a camera is not determined and what to do, after a semicolon.
std::string cause(const RigDescription& rig, CameraId k, const std::vector<TimedThrow>& throws,
                  const Refinement& at) {
  const std::string &name = rig.cameras[k].name, &first = rig.cameras[0].name;
  const std::vector<std::size_t> seen = seen_by(k, throws);
  if (seen.empty())
    return "it shares no throw with the others; throw where camera " + name +
           " and another camera both see the ball";
  if (all_fell_straight_down(seen, at))
    return k == 0 ? "the throws all fell straight down; throw across"
                  : "the throws that it saw all fell straight down: the heading between " + first +
                        " and " + name + " is not determined; throw across";
  return "the throws say too little of it; throw across, in several directions, where camera " +
         name + " and others see the ball";
}

/// The widest direction of a 3x3 covariance, a unit vector, and its sigma.
std::pair<Eigen::Vector3d, double> widest(const Eigen::Matrix3d& covariance) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(covariance);
  return {eigen.eigenvectors().col(2), std::sqrt(std::max(0.0, eigen.eigenvalues()[2]))};
}

/// How much chi-square rises where everything is fitted anew with the rig held `sigmas` away from
/// the solution along a coordinate of its vector. Where the linearisation means anything it rises
/// by their square.
double chi2_rise(const RigDescription& rig, const std::vector<TimedThrow>& throws,
                 const Refinement& at, const Eigen::VectorXd& coordinate_in_sigmas, double sigmas) {
  constexpr double hold = 1e4;  // in sigmas^-2
  Solution moved = at.solution;
  double reached = 0.0;
  for (int i = 0; i < 12; ++i) {
    const NormalEquations normal = normal_equations(rig, throws, moved, at.layout, at.weighting);
    ReducedEquations reduced = eliminate_balls(normal, 1e-9);
    reduced.information += hold * coordinate_in_sigmas * coordinate_in_sigmas.transpose();
    reduced.gradient += hold * (sigmas - reached) * coordinate_in_sigmas;
    const Eigen::VectorXd step = reduced.information.ldlt().solve(reduced.gradient);
    at.layout.apply(step, moved.rig);
    reached += coordinate_in_sigmas.dot(step);
    for (std::size_t j = 0; j < throws.size(); ++j) {
      const NormalEquations::Vector6 move = reduced.ball_step(normal, j, step);
      moved.balls[j].position_m += move.head<3>(), moved.balls[j].velocity_mps += move.tail<3>();
    }
    const double moved_by = step.dot(at.information * step);
    if (moved_by < 1e-4) break;
  }
  return cost(throws, claimed_residuals(rig, throws, moved), at.weighting) - at.chi2;
}

/// Whether a camera's sigma in some direction is a mirage. Drops down one line determine no
/// heading, but their fitted noise has some spread across that looks like a measurement of it, and
/// the linearisation believes it. So the widest direction is tried: three sigmas away chi-square
/// must rise by about nine.
bool is_mirage(const RigDescription& rig, CameraId k, const std::vector<TimedThrow>& throws,
               const Refinement& at, const Matrix6d& covariance) {
  const auto [axis, sigma_rad] = widest(covariance.bottomRightCorner<3, 3>());
  if (k == 0 || sigma_rad < suspicious_rotation_rad) return false;
  Eigen::VectorXd coordinate = Eigen::VectorXd::Zero(at.layout.size());
  const RigLayout::Camera& camera = at.layout.camera(k);
  coordinate.segment<3>(camera.start + camera.rotation) = axis / sigma_rad;
  constexpr double sigmas = 3.0;
  for (double side : {-sigmas, sigmas})
    if (chi2_rise(rig, throws, at, coordinate, side) < sigmas * sigmas / 3) return true;
  return false;
}

/// What of a camera is open; empty where nothing is.
std::string open_part(const RigDescription& rig, CameraId k, const std::vector<TimedThrow>& throws,
                      const Refinement& at) {
  const RigLayout::Camera& camera = at.layout.camera(k);
  for (const Eigen::VectorXd& d : at.undetermined) {
    const auto own = d.segment(camera.start, camera.size);
    const auto holds = [&](int start, int size) {
      return own.segment(start, size).norm() > share_of_direction * d.norm();
    };
    if (holds(0, k == 0 ? 2 : 6)) return "is not determined in one direction at all";
    if (camera.offset && holds(*camera.offset, 1)) return "has a clock that is not determined";
    for (std::size_t i = 0; i < camera.intrinsics.size(); ++i)
      if (holds(camera.lens + static_cast<int>(i), 1))
        return "has a " + name_of(camera.intrinsics[i], rig.cameras[k].model.lens) +
               " that is not determined";
  }
  const Matrix6d covariance = at.layout.pose_covariance(k, at.solution.rig, at.covariance);
  const double position_m = widest(covariance.topLeftCorner<3, 3>()).second;
  const double rotation_rad = widest(covariance.bottomRightCorner<3, 3>()).second;
  const bool open = rotation_rad > wide_rotation_rad || position_m > wide_position_m ||
                    is_mirage(rig, k, throws, at, covariance);
  if (!open) return {};
  char text[160];
  std::snprintf(text, sizeof text, "is not determined (1-sigma %.2g m and %.2g rad at the least)",
                position_m, rotation_rad);
  return text;
}

}  // namespace

std::vector<std::string> undetermined(const RigDescription& rig,
                                      const std::vector<TimedThrow>& throws, const Refinement& at) {
  std::vector<std::string> out;
  for (CameraId k = 0; k < rig.cameras.size(); ++k) {
    const std::string open = at.solution.rig.is_placed[k] ? open_part(rig, k, throws, at)
                                                          : std::string("cannot be placed");
    if (!open.empty())
      out.push_back("camera " + rig.cameras[k].name + " " + open + ": " +
                    cause(rig, k, throws, at));
  }
  const auto drag = at.layout.drag();
  for (const Eigen::VectorXd& d : at.undetermined)
    if (drag && std::abs(d[*drag]) > share_of_direction * d.norm())
      out.push_back("the ball's drag is not determined; throw faster and farther, or state it");
  return out;
}

}  // namespace throwcal
