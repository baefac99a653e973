// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <vector>

#include "estimator/candidate_history.h"

namespace throwcal {

/// Candidates of successive frames that move smoothly: a ball, but also a hand, a head, a bird.
struct Tracklet {
  std::vector<CandidateRef> points;
  double tested_until_s = -1e300;  ///< windows before this time were searched for a flight
  std::size_t measured_until = 0;  ///< points whose noise was measured
};

/// Links candidates loosely, frame by frame: triplets start a tracklet, a quadratic through its
/// last six points carries it on, over gaps of a few frames. Wrong links are repaired later, by the
/// flight itself.
class CandidateLinker {
 public:
  /// Takes the history's newest frame in.
  void add(const CandidateHistory& history);

  /// Tracklets that may still grow, and those that ended since the last `drain_ended`.
  std::vector<Tracklet>& live() { return live_; }
  std::vector<Tracklet> drain_ended();

 private:
  void extend(const CandidateHistory& history, std::vector<bool>& claimed);
  void start(const CandidateHistory& history, const std::vector<bool>& claimed);
  void end_stale(const CandidateHistory& history);

  std::vector<Tracklet> live_, ended_;
};

}  // namespace throwcal
