// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "capture/camera.h"
#include "capture/rig.h"
#include "firmware/config.h"

namespace throwcal {

/// Now, on the clock of the cameras' frames.
HostTime host_now();

/// Where a camera's pictures come from. Throws InputError where the rig file does not say it.
const std::string& source_of(const Config& config, std::size_t camera);

/// The rig file's cameras, opened by their `source` keys. Throws InputError (camera and what was
/// expected) or what the driver says. `may_be_missing`: a device that is not plugged in is waited
/// for.
std::vector<std::unique_ptr<Camera>> open_cameras(const Config& config,
                                                  bool may_be_missing = false);

/// What the detectors must know of the ball.
RigSettings rig_settings(const Config& config);

/// Rings of so many frames, a number each camera, fit into what frames may take: [daemon]
/// frame_memory_mb, or half of the machine's memory. Throws InputError with the sum where they do
/// not.
void check_frame_memory(const Config& config, const std::vector<std::unique_ptr<Camera>>& cameras,
                        const std::vector<std::size_t>& frames);

/// The rig file's cameras at work for the box, their rings within the memory, those waited for that
/// are missing.
/// `warn` is told warnings_of() them.
Rig open_rig(const Config& config, const std::function<void(const std::string&)>& warn);

/// What stands against these cameras, a sentence each: a rate that one was asked for and does not
/// give, a USB bus that carries less than they want.
std::vector<std::string> warnings_of(const Config& config,
                                     const std::vector<std::unique_ptr<Camera>>& cameras);

/// Keeps OpenCV and FFmpeg from printing of their own accord: what matters comes as an error with
/// its place. Call first in main(), before any thread.
void silence_video_libraries();

/// Where pictures are measured by our own detector: its shared error, in each camera for which the
/// rig file states none.
void assume_detector_errors(RigDescription& rig);

}  // namespace throwcal
