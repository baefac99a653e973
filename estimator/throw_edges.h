// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <vector>

#include "estimator/flight_fit.h"
#include "estimator/observation.h"

namespace throwcal {

/// One camera's part of a throw: its sightings, each with its ray (the noise corrected), and how to
/// fit them.
struct ThrowPart {
  Track track;
  std::vector<TimedRay> rays;  ///< one a sighting; times relative to `epoch`
  HostTime epoch{};
  double offset_s = 0.0;  ///< this camera's clock + offset = the throw's clock
  double frame_interval_s = 1.0 / 60.0;
  FlightFitSettings settings;
};

/// Finds where free flight begins and ends, all cameras of a throw together: one frame of the hand
/// before release cannot be told by one camera, but all see it at the same moment. Cuts what costs
/// more than chance allows, then leaves one more frame out as a guard at each end that was cut or
/// is not clear.
void cut_edges(std::vector<ThrowPart>& parts);

}  // namespace throwcal
