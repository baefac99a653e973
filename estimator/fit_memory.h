// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <tuple>
#include <vector>

#include "estimator/flight_fit.h"
#include "estimator/observation.h"

namespace throwcal {

/// Fits of flights, each made once however often it is asked for: from one throw to the next, those
/// of the earlier throws stay the same. What was not asked for between two calls of
/// forget_unused() is forgotten. Of one rig only: its lenses are taken to stay.
class FitMemory {
 public:
  /// fit_flight() of the same arguments. Valid until forget_unused().
  const std::optional<CameraFlight>& of(CameraId camera, HostTime epoch,
                                        std::span<const TimedRay> rays,
                                        const FlightFitSettings& settings);
  const std::optional<CameraFlight>& of(const CameraModel& model, const Track& track,
                                        const FlightFitSettings& settings);
  void forget_unused();

 private:
  /// Camera, first moment; what everything else adds up to, in 64 bits.
  using Key = std::tuple<CameraId, HostTime, std::uint64_t>;
  struct Known {
    std::optional<CameraFlight> flight;
    bool is_used = true;
  };
  template <typename Fit>
  const std::optional<CameraFlight>& look_up(const Key& key, Fit fit);

  std::map<Key, Known> known_;
};

/// Gravity for each of a camera's flights (in order of time, fitted alone) [m/s^2, camera axes]:
/// the mean of what those up to it tell, roughly, or the first few where these are more. So one
/// flight more does not change the earlier ones', and the fits that rest on it stay.
std::vector<std::optional<Eigen::Vector3d>> gravity_of_each(std::span<const CameraFlight> alone);

/// How many flights, in order of time, tell a flight what it shares with them: gravity, noise.
std::size_t informants(std::size_t index, std::size_t flights);

/// All flights of one camera, in order of time: each alone, then again with the gravity that they
/// agree on, which makes the fit linear and several times sharper. One entry a track; nothing where
/// it is no flight.
std::vector<std::optional<CameraFlight>> fit_flights(const CameraModel& model,
                                                     std::span<const Track> tracks,
                                                     const FlightFitSettings& settings,
                                                     FitMemory& fits);

}  // namespace throwcal
