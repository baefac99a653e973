// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <functional>
#include <vector>

#include "estimator/calibration.h"
#include "estimator/ekf.h"

namespace throwcal {

struct ThrowIterationSettings {
  EkfSettings ekf;
  int sweeps = 10;      ///< over all throws; plain EKF always makes one
  double enough = 0.0;  ///< stop when a sweep moves no parameter by more [m, rad, s]
  std::function<void(double fraction_done)> progress = {};
};

/// Repeats the filter over the throws (the thesis' "throw iteration", chapter 5):
///  - ekf: one forward pass over each throw;
///  - r_ekf (5.2): repeats it, keeping the rig and setting each ball back to its given start;
///  - rb_ekf (5.3): runs each throw forward and then backward in time, carrying the ball, so that
///  its start is estimated too.
/// Every sweep chains all throws under one covariance of the rig, which is set back to a wide prior
/// only between sweeps. The centroid noise that the filter believes is three times the median
/// misfit that the last sweep left, between 2 degrees (the first sweep) and 0.3; once a sweep
/// explains no more than the one before, it is 2 degrees again. Why this needs no tuning:
///  - within a sweep every throw weighs the same (a reset at each throw would let the last one
///  win),
///    and between sweeps the gains come back to life (a covariance kept for ever stalls);
///  - what a rough start gets wrong of a prediction is an angle, whatever the lens: wide noise
///  keeps
///    it inside what the filter believes of its innovations;
///  - where the throws tell little, the prior outweighs them at 2 degrees and a sweep goes only
///  part
///    of the way; so the noise follows what is left to explain, not a timetable;
///  - the less noise, the more a sweep's first sightings make the state jump, and what they get
///  wrong
///    by its curvature stays; so the last sweeps, with nothing left to find, are gentle ones.
/// In the end the rig is held and each ball estimated once more, for the throws that came after its
/// own have moved the rig. The filter counts sightings many times, so its own covariance is not the
/// truth's: the refinement's is.
Solution iterate_throws(const RigDescription& rig, const std::vector<TimedThrow>& throws,
                        const Solution& start, Method method,
                        const ThrowIterationSettings& settings = {});

}  // namespace throwcal
