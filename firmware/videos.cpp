// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/videos.h"

#include <algorithm>

#include "capture/camera_factory.h"
#include "capture/quotation.h"
#include "firmware/input_error.h"

namespace throwcal {
namespace {

std::unique_ptr<Camera> open_video(const NamedVideo& video, const Config& config,
                                   const std::string& place) {
  const auto& cameras = config.rig.cameras;
  const auto found = std::ranges::find(cameras, video.camera, &CameraDescription::name);
  if (found == cameras.end())
    throw InputError(place + ": camera " + in_quotes(video.camera) + " is not in the rig file");
  CameraSource source;
  source.id = static_cast<CameraId>(found - cameras.begin());
  source.name = video.camera;
  source.source = "video:" + video.path;
  source.model = found->model;
  source.colour = config.ball_colour.has_value();
  source.paced = false;
  return make_camera(source);
}

}  // namespace

std::optional<NamedVideo> parse_named_video(const std::string& text) {
  const std::size_t equals = text.find('=');
  if (equals == text.npos || equals + 1 == text.size()) return std::nullopt;
  return NamedVideo{text.substr(0, equals), text.substr(equals + 1)};
}

std::vector<std::unique_ptr<Camera>> open_videos(const std::vector<NamedVideo>& videos,
                                                 const Config& config, const std::string& option) {
  std::vector<std::unique_ptr<Camera>> cameras;
  for (const NamedVideo& video : videos) {
    const std::string place = option + video.camera + "=" + video.path;
    const auto is_its = [&](const auto& camera) { return camera->name() == video.camera; };
    if (std::ranges::any_of(cameras, is_its))
      throw InputError(place + ": camera " + in_quotes(video.camera) + " has a video already");
    cameras.push_back(open_video(video, config, place));
  }
  return cameras;
}

void check_ended_well(const Rig& rig) {
  for (const CameraStats& camera : rig.stats())
    if (!camera.error.empty()) throw InputError("camera \"" + camera.name + "\": " + camera.error);
  if (const auto lost = rig.sightings_dropped(); lost > 0)
    throw InputError("the sightings of " + std::to_string(lost) +
                     " frames were lost between detector and estimator");
}

std::vector<std::string> unclear_frames(const Rig& rig) {
  std::vector<std::string> lines;
  for (const CameraStats& camera : rig.stats())
    for (const View view : {View::dark, View::saturated, View::shaken, View::wrong_size}) {
      const std::uint64_t frames = camera.frames_by_view[static_cast<std::size_t>(view)];
      if (frames == 0) continue;
      lines.push_back("camera \"" + camera.name + "\": " + std::to_string(frames) + " of " +
                      std::to_string(camera.frames) + " frames were " +
                      std::string(description(view)));
    }
  return lines;
}

}  // namespace throwcal
