// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "capture/ball_outline.h"
#include "estimator/time.h"

namespace throwcal {

/// A ball in one camera's frame, and what is known of it from the frames before.
struct KnownBall {
  BallOutline outline;
  int hidden_frames = 0;  ///< for how long it was expected and not found
  int shrunk_frames = 0;  ///< for how long it looked smaller than before
  bool was_whole = true;  ///< seen so once, and followed since
};

/// Where balls should be in one camera's next frame, by where they were in the last three: what
/// moved smoothly will do so once more. A guess of where to look first, no verdict on what flies.
class ExpectedBalls {
 public:
  /// `max_found`: of one frame.
  ExpectedBalls(double ball_diameter_m, std::size_t max_found);

  /// Balls expected in a frame at a time, at most eight; none where frames are missing. Valid until
  /// the next call.
  const std::vector<KnownBall>& at(HostTime time);
  /// Takes what was found in that frame. What was expected and not found may only be hidden: it is
  /// taken to have gone on for a few frames.
  void add(HostTime time, std::span<const KnownBall> found);

 private:
  struct Seen {
    HostTime time{};
    std::vector<KnownBall> balls;
  };
  struct Way {
    Eigen::Vector2d step, bend;  ///< the last one, and by how much it differs from that before
  };
  bool is_step(const BallOutline& from, const BallOutline& to, double interval_s) const;
  std::optional<Way> straightest_way(const BallOutline& last) const;

  double ball_diameter_m_;
  std::array<Seen, 3> seen_;  ///< newest first
  std::size_t frames_ = 0;
  std::vector<KnownBall> expected_;
};

}  // namespace throwcal
