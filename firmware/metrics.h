// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "estimator/rig_description.h"

namespace throwcal {

/// What Prometheus is told beside the status.
struct BoxFigures {
  Target target;
  std::size_t tcp_clients = 0, http_connections = 0;
};

/// The status document and the box's figures in Prometheus' text format 0.0.4. What is not known is
/// left out.
std::string to_metrics(const nlohmann::ordered_json& status, const BoxFigures& box);

/// Why the box is not well, in a line: a fault, a camera that does not run. Nothing: it is.
std::optional<std::string> illness(const nlohmann::ordered_json& status);

}  // namespace throwcal
