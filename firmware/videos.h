// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "capture/rig.h"
#include "firmware/config.h"

namespace throwcal {

/// What one camera filmed.
struct NamedVideo {
  std::string camera;  ///< by the rig file's name
  std::string path;
};

/// "north=north.mkv". Nothing where it is not that.
std::optional<NamedVideo> parse_named_video(const std::string& text);

/// One camera a video, each frame handed out as fast as it is taken. Throws InputError where a
/// camera is not in the rig file or has two videos, std::runtime_error where a file cannot be read;
/// `option` names the place.
std::vector<std::unique_ptr<Camera>> open_videos(const std::vector<NamedVideo>& videos,
                                                 const Config& config, const std::string& option);

/// Throws InputError, naming the camera, unless all frames of a rig that has ended were looked at.
void check_ended_well(const Rig& rig);

/// One line a camera and cause: "camera "north": 45 of 487 frames were too dark to see anything
/// in". Frames that were learnt from at first are nothing to tell.
std::vector<std::string> unclear_frames(const Rig& rig);

}  // namespace throwcal
