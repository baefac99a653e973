// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/camera_health.h"

#include <algorithm>

namespace throwcal {
namespace {

/// Frames after which a detector surely knows its background.
constexpr std::uint64_t warm_frames = 30;

void tell_faults(const CameraStats& camera, LogOnce& once) {
  const std::string name = "camera \"" + camera.name + "\": ";
  const auto warn_if = [&](bool is_so, const char* cause, const std::string& text) {
    if (is_so) once.warning(cause + (" " + camera.name), name + text);
  };
  if (camera.running) once.forget("camera " + camera.name);
  warn_if(!camera.error.empty(), "camera", camera.error);
  warn_if(camera.frames_dropped > 0, "drops", "frames dropped, the detector is too slow");
  warn_if(camera.frames_damaged > 0, "damaged", "frames damaged; a loose cable?");
  warn_if(camera.settings.set_back > 0, "set back",
          "another program changed its exposure, gain, focus or white balance; set back");
  if (!camera.settings.automatic.empty())
    warn_if(true, "automatic",
            "its " + camera.settings.automatic.front() +
                " is automatic; a picture that changes is measured worse");
  warn_if(camera.frames_lost_by_driver > 0, "gaps", "frames lost before they reached the box");
}

}  // namespace

bool cameras_are_warm(const std::vector<CameraStats>& cameras) {
  return std::ranges::all_of(cameras, [](const CameraStats& camera) {
    return !camera.running || camera.frames >= warm_frames;
  });
}

std::optional<std::string> camera_trouble(const std::vector<CameraStats>& cameras) {
  const auto well = std::ranges::count_if(cameras, [](const auto& c) { return c.error.empty(); });
  if (well >= 2) return {};
  const auto ill = std::ranges::find_if(cameras, [](const auto& c) { return !c.error.empty(); });
  return "two cameras at least are needed, " + std::to_string(well) + " of " +
         std::to_string(cameras.size()) + " work; camera \"" + ill->name + "\": " + ill->error;
}

void tell_camera_faults(const std::vector<CameraStats>& cameras, LogOnce& once) {
  for (const CameraStats& camera : cameras) tell_faults(camera, once);
}

}  // namespace throwcal
