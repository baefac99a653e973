// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <nlohmann/json.hpp>
#include <vector>

#include "estimator/calibration.h"
#include "firmware/can_messages.h"

namespace throwcal {

struct CanCamera {
  CanPosition position;
  CanRotation rotation;
  CanQuality quality;
};

/// All that a box tells by itself.
struct CanReport {
  CanStatus status;
  CanHealth health;
  CanHeartbeat heartbeat;
  CanResult result;
  std::vector<CanCamera> cameras;
};

/// From the documents that every link shows. What a document lacks is not known.
CanStatus can_status_of(const nlohmann::ordered_json& status);
CanHealth can_health_of(const nlohmann::ordered_json& status);
CanHeartbeat can_heartbeat_of(const nlohmann::ordered_json& status);
/// Of the first eight cameras.
std::vector<CanCamera> can_cameras_of(const Calibration& calibration, int sequence);

struct CanFrame {
  int offset = 0;  ///< from the unit's base identifier
  CanPayload payload{};
};

/// What is due in the n-th tenth of a second. Never many at once, and as many frames a second
/// however many cameras there are: the bus' load is the same always.
std::vector<CanFrame> frames_due(const CanReport& report, std::uint64_t tenth);

}  // namespace throwcal
