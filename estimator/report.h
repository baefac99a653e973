// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <vector>

#include "estimator/calibration.h"
#include "estimator/refinement.h"

namespace throwcal {

/// The result as it is published: poses, covariances, offsets, throws, verdict, and what became of
/// every sighting of `given`. `used` are the throws that took part in the refinement.
Calibration report(const RigDescription& rig, const std::vector<Throw>& given,
                   const std::vector<TimedThrow>& used, const Refinement& refinement,
                   Method method);

/// The result where no camera could be placed at all.
Calibration report_nothing_to_go_by(const RigDescription& rig, const std::vector<Throw>& given,
                                    Method method);

}  // namespace throwcal
