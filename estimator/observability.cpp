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
constexpr double straight_down_mps = 0.2;  // across; a drop from a hand has a tenth of it
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

/// Whether what is known of some throws allows them to be drops down one vertical line: then no
/// camera's heading shows, however narrow its sigma looks, for it comes from the balls' fitted
/// noise. True where their spread across is no more than the noise explains.
bool may_be_one_line(const std::vector<std::size_t>& drops, const RigDescription& rig,
                     const std::vector<TimedThrow>& throws, const Refinement& at) {
  const NormalEquations normal =
      normal_equations(rig, throws, at.solution, at.layout, at.weighting);
  const ReducedEquations reduced = eliminate_balls(normal, 0.0);
  std::vector<Eigen::Vector2d> ends;
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  double noise_m2 = 0.0;
  for (std::size_t j : drops)
    for (const TimedSighting* s : {&throws[j].sightings.front(), &throws[j].sightings.back()}) {
      const double time_s = moment_s(at.solution.rig, *s);
      const BallState ball =
          fly(at.solution.balls[j], time_s, {0, 0, -rig.gravity_mps2}, at.solution.rig.drag_per_m);
      ends.push_back(ball.position_m.head<2>());
      mean += ends.back();
      // The ball's noise where the rig is known, and what the rig's uncertainty adds (a tilt of
      // camera 1 makes all balls drift alike).
      const NormalEquations::Matrix6& root = reduced.ball_root[j];
      const Eigen::Matrix<double, 2, 6> own = root.topRows<2>() + time_s * root.middleRows<2>(3);
      const Eigen::MatrixXd by_rig = own * root.transpose() * normal.balls[j].coupling.transpose();
      noise_m2 += own.squaredNorm() + (by_rig * at.covariance).cwiseProduct(by_rig).sum();
    }
  mean /= static_cast<double>(ends.size());
  double spread_m2 = 0.0;
  for (const Eigen::Vector2d& end : ends) spread_m2 += (end - mean).squaredNorm();
  return spread_m2 < 3 * noise_m2;
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

double widest(const Eigen::Matrix3d& covariance) {
  const double variance =
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(covariance).eigenvalues()[2];
  return std::sqrt(std::max(0.0, variance));
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
  const double position_m = widest(covariance.topLeftCorner<3, 3>());
  const double rotation_rad = widest(covariance.bottomRightCorner<3, 3>());
  bool open = rotation_rad > wide_rotation_rad || position_m > wide_position_m;
  if (const auto seen = seen_by(k, throws); !open && k > 0 && all_fell_straight_down(seen, at))
    open = may_be_one_line(seen, rig, throws, at);
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
