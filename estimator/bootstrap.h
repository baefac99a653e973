// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "estimator/calibrate.h"
#include "estimator/fit_memory.h"
#include "estimator/super_state.h"
#include "estimator/throw_set.h"

namespace throwcal {

/// Every throw's flight as each camera alone sees it: [throw][camera], nothing where that camera's
/// sightings fix none.
using FlightTable = std::vector<std::vector<std::optional<CameraFlight>>>;

FlightTable fit_all_flights(const RigDescription& rig, const std::vector<Throw>& throws,
                            FitMemory& fits);

/// First rig from flights that several cameras saw; no guess needed. One camera alone fixes a
/// flight in its own frame, metric and with the vertical; flights that two cameras share give the
/// yaw, the translation and the clock offset between them; a tree of such pairs reaches from camera
/// 1 to all that it can. Cameras out of reach stay unplaced; balls that no placed camera fixes are
/// nothing. Nothing at all where camera 1 saw no flight, or looks straight up or down.
struct Start {
  RigState rig;
  std::vector<std::optional<BallState>> balls;  ///< of each throw, at its epoch on camera 1's clock
};
std::optional<Start> bootstrap(const RigDescription& rig, const std::vector<TimedThrow>& throws,
                               const FlightTable& flights);

/// The same from a guess of the poses, moved into the world frame of the contract.
Start start_from_guess(const RigDescription& rig, const std::vector<TimedThrow>& throws,
                       const FlightTable& flights, const Guess& guess);

}  // namespace throwcal
