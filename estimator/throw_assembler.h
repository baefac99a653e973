// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <vector>

#include "estimator/observation.h"
#include "estimator/rig_description.h"
#include "estimator/throw_part.h"

namespace throwcal {

struct ThrowAssemblerSettings {
  double max_offset_s = 0.05;  ///< clocks are off by at most this
};

/// Puts the flights of several cameras together into throws, by time and by the physics: one flight
/// has one horizontal speed and one apex. Needs no pose; finds them on the way. What no second
/// camera confirms is left out.
class ThrowAssembler {
 public:
  explicit ThrowAssembler(const RigDescription& rig, ThrowAssemblerSettings settings = {});

  void add(const Track& track);
  /// All throws that the tracks so far make, ordered by time, named "1", "2", ... in that order. In
  /// whichever order the tracks came, the same tracks make the same throws.
  std::vector<Throw> assemble();

 private:
  RigDescription rig_;
  ThrowAssemblerSettings settings_;
  std::vector<ThrowPart> parts_;  // a track each, as it came
  FitMemory fits_;
};

}  // namespace throwcal
