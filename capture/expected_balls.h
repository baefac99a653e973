// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "capture/ball_outline.h"
#include "estimator/time.h"

namespace throwcal {

/// Where balls should be in one camera's next frame, by where they were in the last three: what
/// moved smoothly will do so once more. A guess of where to look first, no verdict on what flies.
class ExpectedBalls {
 public:
  explicit ExpectedBalls(double ball_diameter_m);

  /// Outlines expected in a frame at a time, at most eight; none where frames are missing. Valid
  /// until the next call.
  const std::vector<BallOutline>& at(HostTime time);
  /// Takes what was found in that frame. What was expected and not found may only be hidden: it is
  /// taken to have gone on for a few frames.
  void add(HostTime time, std::span<const BallOutline> found);

 private:
  struct Ball {
    BallOutline outline;
    int hidden_frames = 0;
  };
  struct Seen {
    HostTime time{};
    std::vector<Ball> balls;
  };
  bool is_step(const BallOutline& from, const BallOutline& to, double interval_s) const;

  double ball_diameter_m_;
  std::array<Seen, 3> seen_;  ///< newest first
  std::size_t frames_ = 0;
  std::vector<Ball> expected_balls_;
  std::vector<BallOutline> expected_;
};

}  // namespace throwcal
