// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <array>
#include <optional>
#include <string>
#include <vector>

#include "estimator/observation.h"
#include "estimator/rig_description.h"
#include "estimator/super_state.h"
#include "estimator/throw_set.h"

/// The experiments of the 2008 thesis in its own numbers, turned into our rigs, recordings and
/// starts, and our estimates turned back.
namespace throwcal::test {

/// C of eq. (4.11): [a1 b1 | a2 b2 g2 | x y z], camera 1's turns about z and x, camera 2's about z,
/// x and z [rad], and camera 2's centre [m], in the basis frame (x left, y up, z forward). The
/// turns are of the axes, in this order: R1 = Rx(b1) Rz(a1), R2 = Rz(g2) Rx(b2) Rz(a2). Of all
/// readings of "z-x-z" only this one puts the balls of 6.4, 6.5, 7.7 and 7.8 before both cameras
/// and lets the top of 7.7's flight leave camera 2's picture, as the thesis tells.
using ThesisCameras = Eigen::Vector<double, 8>;

/// X and V at the first frame, basis frame [m], [m/s].
struct ThesisBall {
  Eigen::Vector3d X, V;
};

struct ThesisThrow {
  ThesisBall truth, guess;
  int most_in_camera2 = 1000;  ///< what camera 2 sees after that many frames is lost
};

struct ThesisExperiment {
  std::string name;
  ThesisCameras truth = ThesisCameras::Zero(), guess = ThesisCameras::Zero();
  std::vector<ThesisThrow> throws = {};
  double sigma_ball_m = 0.0;  ///< of each axis, anew in every frame; both cameras see it
  double sigma_px = 0.0;
  /// Chapter 7's cameras: 25 frames/s, lenses that distort, pictures of 354 x 248 that the ball
  /// leaves. Chapter 6's are pinholes of the same focal lengths: 30 frames of every throw at 30/s,
  /// wherever the ball goes.
  bool is_real = false;
  bool is_parallel = false;  ///< a2 and g2 then turn about the same axis: z-x-z angles mean nothing
  /// A vertical drop looks the same from all around, so nothing tells camera 2's bearing from it.
  bool is_drop = false;
};

/// R of x_cam = R (X - C), from the basis frame to the thesis' camera frame (x left, y up, z
/// forward). The thesis holds the heading by camera 1's x axis: it has no part along z.
struct ThesisPoses {
  Eigen::Matrix3d R1, R2;
  Eigen::Vector3d C2;
};

ThesisPoses thesis_poses(const ThesisCameras& cameras);
ThesisCameras thesis_cameras(const ThesisPoses& poses);
Eigen::Matrix3d turn_x(double angle_rad);  ///< of the axes: the transpose of the vectors' turn
Eigen::Matrix3d turn_z(double angle_rad);

/// An estimate in the thesis' terms.
struct ThesisEstimate {
  ThesisPoses poses;
  std::vector<ThesisBall> balls;
};

/// From our world frame; balls at their first frames.
ThesisEstimate thesis_estimate(const std::vector<Rigid>& T_world_cam,
                               const std::vector<BallState>& balls);

/// Where both cameras would see a ball at X; nothing behind a camera.
using Sight = std::array<std::optional<Eigen::Vector2d>, 2>;
Sight sight_of(const ThesisExperiment& experiment, const ThesisPoses& poses,
               const Eigen::Vector3d& X);

Eigen::Vector3d flown(const ThesisBall& ball, double time_s);

/// The frames in which a throw is seen, by which cameras; the noise does not change them.
struct SeenFrame {
  double time_s;  ///< from the throw's first frame
  std::array<bool, 2> by;
};
std::vector<SeenFrame> seen_frames(const ThesisExperiment& experiment, const ThesisThrow& thrown);

struct ThesisRecording {
  RigDescription rig;
  std::vector<Throw> throws;  ///< named "1", "2", ...
};
ThesisRecording record(const ThesisExperiment& experiment, std::uint64_t seed);

HostTime first_frame(std::size_t j);  ///< of throw j, on the cameras' clock

/// The experiment's guess in our world frame, balls at their throws' epochs.
Solution guessed_solution(const ThesisExperiment& experiment, const RigDescription& rig,
                          const std::vector<TimedThrow>& throws);

}  // namespace throwcal::test
