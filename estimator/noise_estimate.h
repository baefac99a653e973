// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <deque>
#include <optional>

#include "estimator/candidate_linker.h"

namespace throwcal {

/// How far the sightings' true noise exceeds what they state, from fourth differences of what moves
/// smoothly: they cancel every path that a cubic describes and leave sqrt(70) times the noise.
class NoiseEstimate {
 public:
  /// Takes in the points of a tracklet that were not measured yet.
  void add(const CandidateHistory& history, Tracklet& tracklet);

  /// True noise over stated noise; nothing before there are enough differences.
  std::optional<double> scale() const;

 private:
  std::deque<double> ratios_;
};

}  // namespace throwcal
