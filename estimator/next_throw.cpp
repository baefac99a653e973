// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/next_throw.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <numeric>

#include "estimator/elementary.h"
#include "estimator/flight_path.h"

namespace throwcal {
namespace {

constexpr double flight_s = 0.8;
constexpr int moments = 6;  // of a flight that is judged, each in place of several frames
constexpr double margin_px = 10.0, max_range_m = 20.0;
constexpr std::size_t judged_exactly = 6;
constexpr double weak_information = 0.01;  // sigma of 10 in every unit: makes the unknown finite

/// How a camera looks at a flight: its noise and how often.
struct Viewer {
  double sigma_px = 0.2, frames_per_s = 30.0;
};

std::vector<Viewer> viewers_of(const std::vector<TimedThrow>& throws, const Refinement& at) {
  std::vector<Viewer> out(at.solution.rig.cameras());
  std::vector<double> variance(out.size(), 0.0), count(variance), intervals(variance);
  std::vector<double> shortest(out.size(), 1.0);
  for (std::size_t j = 0; j < throws.size(); ++j) {
    std::vector<const TimedSighting*> before(out.size(), nullptr);
    for (std::size_t i = 0; i < throws[j].sightings.size(); ++i) {
      const TimedSighting& s = throws[j].sightings[i];
      if (!at.weighting.used[j][i]) continue;
      variance[s.camera] += 0.5 * s.whitening.inverse().squaredNorm(), count[s.camera] += 1;
      if (before[s.camera] && s.row0_s - before[s.camera]->row0_s > 1e-4)
        shortest[s.camera] = std::min(shortest[s.camera], s.row0_s - before[s.camera]->row0_s);
      before[s.camera] = &s;
    }
  }
  for (std::size_t k = 0; k < out.size(); ++k) {
    if (count[k] > 0)
      out[k].sigma_px = at.weighting.noise_scale[k] * std::sqrt(variance[k] / count[k]);
    if (shortest[k] < 1.0) out[k].frames_per_s = 1.0 / shortest[k];
  }
  return out;
}

/// A throw that nobody has thrown yet, as the cameras would see it.
struct Imagined {
  BallState release;
  TimedThrow thrown;  ///< a few sightings, each with the weight of all frames about it
  std::vector<CameraId> cameras;
};

Imagined imagine(const RigDescription& rig, const RigState& state,
                 const std::vector<Viewer>& viewers, const BallState& release) {
  Imagined out{release, {}, {}};
  std::vector<int> seen(viewers.size(), 0);
  for (int i = 0; i < moments; ++i) {
    const double time_s = (i + 0.5) * flight_s / moments;
    const BallState ball = fly(release, time_s, {0, 0, -rig.gravity_mps2}, state.drag_per_m);
    for (CameraId k = 0; k < viewers.size(); ++k) {
      if (!state.is_placed[k]) continue;
      const Eigen::Vector3d point = state.T_world_cam[k].inverse() * ball.position_m;
      const auto pixel = state.models[k].project(point);
      if (!pixel || !state.models[k].contains(*pixel, margin_px) || point.norm() > max_range_m)
        continue;
      const double frames = viewers[k].frames_per_s * flight_s / moments;
      out.thrown.sightings.push_back(
          {k, time_s - state.time_offset_s[k] - state.models[k].row_time_s * pixel->y(), *pixel,
           std::sqrt(frames) / viewers[k].sigma_px * Eigen::Matrix2d::Identity()});
      ++seen[k];
    }
  }
  for (CameraId k = 0; k < viewers.size(); ++k)
    if (2 * seen[k] > moments) out.cameras.push_back(k);
  return out;
}

Eigen::MatrixXd information_of(const RigDescription& rig, const RigState& state,
                               const RigLayout& layout, const Imagined& imagined) {
  const Weighting weighting{{std::vector<char>(imagined.thrown.sightings.size(), 1)},
                            std::vector<double>(state.cameras(), 1.0)};
  const Solution there{state, {imagined.release}};
  return eliminate_balls(normal_equations(rig, {imagined.thrown}, there, layout, weighting), 0.0)
      .information;
}

/// How fast a throw's information dI would begin to lower the worst camera's variances: the trace
/// of answer^T dI answer, its ball free. Sighting by sighting, for dI is large and mostly zero.
double promise_of(const RigDescription& rig, const RigState& state, const RigLayout& layout,
                  const Imagined& imagined, const Eigen::MatrixXd& answer) {
  const Eigen::Matrix<double, 3, 2> turns = camera_one_turns(state.T_world_cam[0]);
  FlightPath path(imagined.release, {0, 0, -rig.gravity_mps2}, state.drag_per_m,
                  FlightPath::Wants::sensitivities, rig.ball.estimate_drag);
  using Answer = Eigen::Matrix<double, 2, Eigen::Dynamic, 0, 2, 6>;
  using Cross = Eigen::Matrix<double, 6, Eigen::Dynamic, 0, 6, 6>;
  double own = 0.0;
  Eigen::Matrix<double, 6, 6> of_ball = Eigen::Matrix<double, 6, 6>::Zero();
  Cross cross = Cross::Zero(6, answer.cols());
  SightingModel model;
  RigLayout::CameraJacobian J_camera;
  Eigen::Matrix<double, 2, 6> J_ball;
  for (const TimedSighting& s : imagined.thrown.sightings) {
    const RigLayout::Camera& camera = layout.camera(s.camera);
    const Propagation& ball = path.at(moment_s(state, s));
    if (!model_sighting(state, ball.state, s, !camera.intrinsics.empty(), true, model)) continue;
    layout.fill_jacobian(s.camera, model, turns, J_camera);
    J_ball << model.J_position, model.J_position * ball.J_position_velocity0;
    Answer moved = J_camera.lazyProduct(answer.middleRows(camera.start, camera.size));
    if (const auto drag = layout.drag())
      moved += (model.J_position * ball.J_position_drag).eval().lazyProduct(answer.row(*drag));
    own += moved.squaredNorm();
    of_ball += J_ball.transpose().lazyProduct(J_ball);
    cross += J_ball.transpose().lazyProduct(moved);
  }
  return own - cross.cwiseProduct(of_ball.ldlt().solve(cross)).sum();
}

/// Releases to choose from: about where the ball has been thrown before, from the usual height, to
/// all sides, steep and far.
std::vector<BallState> releases(const RigDescription& rig, const std::vector<TimedThrow>& throws,
                                const Refinement& at) {
  Eigen::Vector3d low = Eigen::Vector3d::Constant(1e9), high = -low;
  double height = 0.0, count = 0.0;
  for (std::size_t j = 0; j < throws.size(); ++j) {
    if (std::none_of(at.weighting.used[j].begin(), at.weighting.used[j].end(),
                     [](char u) { return u; }))
      continue;
    for (const TimedSighting* s : {&throws[j].sightings.front(), &throws[j].sightings.back()}) {
      const BallState ball = fly(at.solution.balls[j], moment_s(at.solution.rig, *s),
                                 {0, 0, -rig.gravity_mps2}, at.solution.rig.drag_per_m);
      low = low.cwiseMin(ball.position_m), high = high.cwiseMax(ball.position_m);
      if (s == &throws[j].sightings.front()) height += ball.position_m.z(), count += 1;
    }
  }
  std::vector<BallState> out;
  if (count == 0) return out;
  const Eigen::Vector3d centre = 0.5 * (low + high);
  const Eigen::Vector3d reach = (0.5 * (high - low)).cwiseMax(0.3).cwiseMin(3.0);
  constexpr std::array<std::array<double, 2>, 2> speeds{{{1.0, 4.2}, {2.8, 3.6}}};
  for (double x : {-1.0, 0.0, 1.0})
    for (double y : {-1.0, 0.0, 1.0})
      for (int turn = 0; turn < 8; ++turn)
        for (const auto& [across, up] : speeds) {
          const double angle = turn * std::numbers::pi / 4;
          out.push_back({{centre.x() + x * reach.x(), centre.y() + y * reach.y(), height / count},
                         {across * elementary::cos(angle), across * elementary::sin(angle), up}});
        }
  return out;
}

/// The worst camera, measured by its target.
struct Worst {
  CameraId camera = 0;
  double over_target = 0.0, position_m = 0.0, rotation_rad = 0.0;
};

Worst worst_of(const RigDescription& rig, const Refinement& at, const Eigen::MatrixXd& covariance) {
  Worst out;
  for (CameraId k = 0; k < rig.cameras.size(); ++k) {
    if (!at.solution.rig.is_placed[k]) continue;
    const Eigen::Matrix<double, 6, 1> variance =
        at.layout.pose_covariance(k, at.solution.rig, covariance).diagonal();
    const double position_m = std::sqrt(variance.head<3>().sum());
    const double rotation_rad = std::sqrt(variance.tail<3>().sum());
    const double over =
        std::max(position_m / rig.target.position_m, rotation_rad / rig.target.rotation_rad);
    if (over > out.over_target) out = {k, over, position_m, rotation_rad};
  }
  return out;
}

Eigen::MatrixXd inverse_of(Eigen::MatrixXd information) {
  information.diagonal().array() += weak_information;
  return information.llt().solve(Eigen::MatrixXd::Identity(information.rows(), information.cols()));
}

std::string camera_ahead(const RigDescription& rig, const RigState& state,
                         const BallState& release) {
  const Eigen::Vector3d way(release.velocity_mps.x(), release.velocity_mps.y(), 0);
  std::string best;
  double nearest = 0.7;  // within 45 degrees, or it is no help
  for (std::size_t k = 0; k < rig.cameras.size(); ++k) {
    if (!state.is_placed[k]) continue;
    Eigen::Vector3d to = state.T_world_cam[k].translation - release.position_m;
    to.z() = 0;
    const double cosine = way.normalized().dot(to.normalized());
    if (cosine > nearest) nearest = cosine, best = " towards camera " + rig.cameras[k].name;
  }
  return best;
}

std::string in_words(const RigDescription& rig, const Refinement& at, const NextThrow& t) {
  const Eigen::Vector3d &p = t.position_world_m, &v = t.velocity_world_mps;
  char text[500];
  std::snprintf(
      text, sizeof text,
      "throw from %.1f m ahead of camera %s, %.1f m to its %s and %.1f m %s it,%s %.0f degrees to "
      "the %s of its view, at %.1f m/s, %.0f degrees upwards: camera %s would go from %.1f mm and "
      "%.2f mrad to %.1f mm and %.2f mrad",
      p.x(), rig.cameras[0].name.c_str(), std::abs(p.y()), p.y() >= 0 ? "left" : "right",
      std::abs(p.z()), p.z() >= 0 ? "above" : "below",
      camera_ahead(rig, at.solution.rig, {p, v}).c_str(),
      std::abs(elementary::atan2(v.y(), v.x())) * 180 / std::numbers::pi,
      v.y() >= 0 ? "left" : "right", v.norm(),
      elementary::atan2(v.z(), v.head<2>().norm()) * 180 / std::numbers::pi,
      rig.cameras[t.camera].name.c_str(), 1e3 * t.sigma_position_m, 1e3 * t.sigma_rotation_rad,
      1e3 * t.expected_sigma_position_m, 1e3 * t.expected_sigma_rotation_rad);
  return text;
}

}  // namespace

std::optional<NextThrow> best_next_throw(const RigDescription& rig,
                                         const std::vector<TimedThrow>& throws,
                                         const Refinement& at) {
  const std::vector<Viewer> viewers = viewers_of(throws, at);
  const Eigen::MatrixXd covariance = inverse_of(at.information);
  const Worst now = worst_of(rig, at, covariance);
  if (now.over_target == 0.0) return std::nullopt;

  // First, without air, what each throw promises, then the best few exactly.
  const RigLayout::Camera& worst = at.layout.camera(now.camera);
  const int free = now.camera == 0 ? 2 : 6;
  Eigen::MatrixXd answer = covariance.middleCols(worst.start, free);
  for (int i = 0; i < free; ++i)
    answer.col(i) /= i < worst.rotation ? rig.target.position_m : rig.target.rotation_rad;
  std::vector<Imagined> seen;
  std::vector<double> promise;
  RigDescription airless = rig;
  airless.ball.estimate_drag = false;
  RigState state = at.solution.rig;
  state.drag_per_m = 0.0;
  for (const BallState& release : releases(rig, throws, at)) {
    Imagined imagined = imagine(airless, state, viewers, release);
    if (imagined.cameras.size() < 2) continue;
    promise.push_back(promise_of(airless, state, at.layout, imagined, answer));
    seen.push_back(std::move(imagined));
  }
  std::vector<std::size_t> order(seen.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return promise[a] > promise[b]; });
  order.resize(std::min(order.size(), judged_exactly));

  std::optional<NextThrow> best;
  double lowest = now.over_target;
  for (std::size_t i : order) {
    const Imagined flown = imagine(rig, at.solution.rig, viewers, seen[i].release);
    if (flown.cameras.size() < 2) continue;
    const Eigen::MatrixXd after =
        inverse_of(at.information + information_of(rig, at.solution.rig, at.layout, flown));
    const double over = worst_of(rig, at, after).over_target;
    if (over >= lowest) continue;
    lowest = over;
    const Eigen::Matrix<double, 6, 1> variance =
        at.layout.pose_covariance(now.camera, at.solution.rig, after).diagonal();
    best = NextThrow{flown.release.position_m,
                     flown.release.velocity_mps,
                     flown.cameras,
                     now.camera,
                     now.position_m,
                     now.rotation_rad,
                     std::sqrt(variance.head<3>().sum()),
                     std::sqrt(variance.tail<3>().sum()),
                     {}};
  }
  if (best) best->text = in_words(rig, at, *best);
  return best;
}

}  // namespace throwcal
