// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <nlohmann/json.hpp>
#include <vector>

#include "capture/rig.h"
#include "estimator/rig_description.h"
#include "firmware/session.h"

namespace throwcal {

/// Everything that anybody may want to know of the box at one moment; every way out shows this.
struct Status {
  SessionState state = SessionState::idle;
  std::optional<std::int64_t> session;
  int throws = 0;
  std::vector<CameraStats> cameras;
  std::vector<int> flights;  ///< a count each camera, this session
  std::uint64_t sightings_dropped = 0;
  std::optional<double> worst_sigma_position_m, worst_sigma_rotation_rad;
  std::optional<Verdict> verdict;
  std::optional<std::int64_t> calibration;  ///< the id of the session's last one
  std::vector<std::string> reasons;
  Target target;
  int target_throws = 0;                  ///< that must agree before the session ends itself
  bool ends_itself = true;                ///< once it has reached the target
  std::optional<std::string> next_throw;  ///< which would help most
  std::optional<std::string> calibration_problem;  ///< why the last one is not of these cameras
  std::optional<std::string> fault;  ///< of the box itself, as a store that can't be written
  nlohmann::ordered_json can;        ///< of the CAN link; null where there is none
  double uptime_s = 0.0;
};

/// What to do now, a sentence for whoever stands at the box.
std::string advice(const Status& status);

Status status_of(const Session& session, const Rig& rig);

nlohmann::ordered_json to_json(const Status& status);

}  // namespace throwcal
