// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <optional>
#include <vector>

#include "estimator/calibration.h"
#include "estimator/refinement.h"

namespace throwcal {

/// Of the throws that at least two placed cameras can see, near where the ball has been thrown: the
/// one whose information, added to what is known already, lowers the worst camera's uncertainty
/// (over its target) most. Nothing where fewer than two cameras are placed or no throw was used.
std::optional<NextThrow> best_next_throw(const RigDescription& rig,
                                         const std::vector<TimedThrow>& throws,
                                         const Refinement& at);

}  // namespace throwcal
