// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <vector>

#include "estimator/fit_memory.h"

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

/// The flight of `count` sightings from `first` on.
inline const std::optional<CameraFlight>& fit_of(const ThrowPart& part, std::size_t first,
                                                 std::size_t count, FitMemory& fits) {
  return fits.of(part.track.camera, part.epoch, std::span(part.rays).subspan(first, count),
                 part.settings);
}
inline const std::optional<CameraFlight>& fit_of(const ThrowPart& part, FitMemory& fits) {
  return fit_of(part, 0, part.rays.size(), fits);
}

}  // namespace throwcal
