// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <string>
#include <vector>

#include "estimator/rig_description.h"
#include "firmware/sightings_file.h"

namespace throwcal {

/// Whether there is anything to calibrate by: two cameras that saw something and, where all rows
/// are labelled, a throw of 5 sightings by one camera, from which that camera alone can tell the
/// flight; and no label that covers more than one flight can last. Whether it is enough is for the
/// estimator to say, this is only what no calibration can begin with. Throws InputError, in which
/// `name` stands for the file.
void check_usable(const std::vector<SightingRow>& rows, const RigDescription& rig,
                  const std::string& name);

}  // namespace throwcal
