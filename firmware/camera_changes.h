// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "capture/rig.h"

namespace throwcal {

/// {"north": {"port", "model", "serial", "mode"}, ...}: the devices behind the cameras, as far as
/// they are known; a film or a simulated camera has none. `only_working`: not of a camera that has
/// an error, as a stranger at its port.
nlohmann::ordered_json devices_of(const std::vector<CameraStats>& cameras, bool only_working);

/// Gives each camera of a calibration document its `device`.
void add_devices(nlohmann::ordered_json& document, const nlohmann::ordered_json& devices);

/// Why a calibration document is not that of these devices, a sentence each: cables swapped,
/// another camera, another size. Empty: nothing is known against it.
std::vector<std::string> camera_changes(const nlohmann::ordered_json& document,
                                        const nlohmann::ordered_json& devices_now);

}  // namespace throwcal
