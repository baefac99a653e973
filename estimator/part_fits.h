// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <cstddef>
#include <map>
#include <optional>
#include <tuple>
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

/// Fits of parts, each made once however often it is asked for: from one throw to the next, those
/// of the earlier throws stay the same. What was not asked for between two calls of
/// forget_unused() is forgotten.
class PartFits {
 public:
  /// Of `count` sightings from `first` on. The parts' rays must all be of one rig's sightings: then
  /// the first and the last ray and their number tell which they are.
  const std::optional<CameraFlight>& of(const ThrowPart& part, std::size_t first,
                                        std::size_t count);
  const std::optional<CameraFlight>& of(const ThrowPart& part) {
    return of(part, 0, part.rays.size());
  }
  void forget_unused();

 private:
  /// Camera, epoch; time and weight of the first and the last ray, their number; settings.
  using Key = std::tuple<CameraId, HostTime, double, double, double, double, std::size_t, bool,
                         double, double, double, double>;
  struct Known {
    std::optional<CameraFlight> flight;
    bool is_used = true;
  };
  std::map<Key, Known> known_;
};

}  // namespace throwcal
