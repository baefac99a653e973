// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <string>
#include <vector>

#include "estimator/refinement.h"

namespace throwcal {

/// What these throws do not determine, a sentence a camera: what is open (where it stands, its
/// heading, its clock, a lens number), why (it shares no throw, they all fell straight down), and
/// what to do about it. Empty where everything is determined, well or badly.
std::vector<std::string> undetermined(const RigDescription& rig,
                                      const std::vector<TimedThrow>& throws, const Refinement& at);

}  // namespace throwcal
