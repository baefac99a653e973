// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <vector>

#include "estimator/throw_part.h"

namespace throwcal {

/// Finds where free flight begins and ends, all cameras of a throw together: one frame of the hand
/// before release cannot be told by one camera, but all see it at the same moment. Cuts what costs
/// more than chance allows, then leaves one more frame out as a guard at each end that was cut or
/// is not clear.
void cut_edges(std::vector<ThrowPart>& parts, FitMemory& fits);

}  // namespace throwcal
