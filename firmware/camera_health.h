// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "capture/rig.h"
#include "firmware/journal.h"

namespace throwcal {

/// Every camera that runs has learnt its background.
bool cameras_are_warm(const std::vector<CameraStats>& cameras);

/// Why nothing could be captured: fewer than two cameras are well. One that has shown its whole
/// film is.
std::optional<std::string> camera_trouble(const std::vector<CameraStats>& cameras);

/// What is wrong with each, once.
void tell_camera_faults(const std::vector<CameraStats>& cameras, LogOnce& once);

}  // namespace throwcal
