// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/cameras.h"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <opencv2/core/utils/logger.hpp>

#include "capture/camera_factory.h"
#include "firmware/input_error.h"
#include "firmware/text_file.h"

namespace throwcal {
namespace {

/// Sightings wait while the estimator is at a calibration of many throws: minutes of eight cameras.
constexpr int queue_frames = 1 << 16;

/// Of the camera of that name; 0: none was.
double asked_rate(const Config& config, const std::string& name) {
  for (std::size_t i = 0; i < config.inputs.size(); ++i)
    if (config.rig.cameras[i].name == name) return config.inputs[i].device.frames_per_s;
  return 0.0;
}

/// A simulated picture must be what the rig file says of its camera.
void check_simulated(const Config& config, CameraId id, const SimulatedScene& scene) {
  const CameraDescription& camera = config.rig.cameras[id];
  const std::string place = "camera \"" + camera.name + "\": ";
  if (id >= static_cast<CameraId>(scene.settings().cameras))
    throw InputError(place + "[simulation] has only " + std::to_string(scene.settings().cameras) +
                     " cameras; expected one for each simulated camera");
  if (camera.model.width_px != scene.settings().width_px ||
      camera.model.height_px != scene.settings().height_px)
    throw InputError(place + "width_px and height_px must be those of [simulation]");
}

std::size_t half_the_memory_bytes() {
  return static_cast<std::size_t>(sysconf(_SC_PHYS_PAGES)) / 2 *
         static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
}

std::string megabytes(std::size_t bytes) {
  return std::to_string((bytes + 500'000) / 1'000'000) + " MB";
}

}  // namespace

HostTime host_now() {
  return HostTime(std::chrono::duration_cast<HostClock::duration>(
      std::chrono::steady_clock::now().time_since_epoch()));
}

const std::string& source_of(const Config& config, std::size_t camera) {
  const std::string& source = config.inputs.at(camera).source;
  if (!source.empty()) return source;
  throw InputError("camera \"" + config.rig.cameras.at(camera).name +
                   "\" has no source; expected source = \"simulated\", \"video:PATH\", "
                   "\"v4l2:DEVICE\" or \"libcamera:ID\"");
}

std::vector<std::unique_ptr<Camera>> open_cameras(const Config& config, bool may_be_missing) {
  std::vector<NamedSerial> others;
  for (std::size_t i = 0; i < config.inputs.size(); ++i)
    others.push_back({config.inputs[i].device.serial, config.rig.cameras[i].name});
  const auto scene = std::make_shared<const SimulatedScene>(config.simulation);
  const HostTime start = host_now();
  std::vector<std::unique_ptr<Camera>> cameras;
  for (CameraId id = 0; id < config.rig.cameras.size(); ++id) {
    const CameraDescription& camera = config.rig.cameras[id];
    CameraSource source;
    source.id = id;
    source.name = camera.name;
    source.source = source_of(config, id);
    source.device = config.inputs[id].device;
    source.may_be_missing = may_be_missing;
    source.others = others;
    source.model = camera.model;
    source.colour = config.ball_colour.has_value();
    source.scene = scene;
    source.scene_start = start;
    if (source.source == "simulated") check_simulated(config, id, *scene);
    cameras.push_back(make_camera(source));
  }
  return cameras;
}

void silence_video_libraries() {
  setenv("OPENCV_FFMPEG_LOGLEVEL", "-8", 0);  // AV_LOG_QUIET
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
}

void assume_detector_errors(RigDescription& rig) {
  for (CameraDescription& camera : rig.cameras)
    if (camera.sigma_common_px == 0.0) camera.sigma_common_px = sigma_common_centre_px;
}

RigSettings rig_settings(const Config& config) {
  RigSettings settings;
  settings.ball_diameter_m = config.rig.ball.diameter_m;
  settings.queue_frames = queue_frames;
  settings.detector.ball_colour = config.ball_colour;
  return settings;
}

void check_frame_memory(const Config& config, const std::vector<std::unique_ptr<Camera>>& cameras,
                        const std::vector<std::size_t>& frames) {
  const std::size_t most = config.frame_memory_bytes.value_or(half_the_memory_bytes());
  std::size_t sum = 0;
  std::string each;
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    const Camera::Format format = cameras[i]->format();
    const std::size_t bytes = ring_bytes(format, frames[i]);
    sum += bytes;
    each += (i ? ", " : "") + cameras[i]->name() + " " + std::to_string(frames[i]) + " of " +
            std::to_string(format.width_px) + "x" + std::to_string(format.height_px) + " in " +
            megabytes(bytes);
  }
  if (sum > most)
    throw InputError("frames need " + megabytes(sum) + " of memory (" + each + "); expected " +
                     megabytes(most) +
                     " at most, by [daemon] frame_memory_mb or half of this machine's: film for "
                     "less long, more slowly or smaller");
}

std::vector<std::string> warnings_of(const Config& config,
                                     const std::vector<std::unique_ptr<Camera>>& cameras) {
  std::vector<UsbStream> streams;
  for (const auto& camera : cameras)
    if (auto stream = camera->usb_stream()) streams.push_back(*std::move(stream));
  std::vector<std::string> out = usb_overloads(streams);
  for (const auto& camera : cameras) {
    const double asked = asked_rate(config, camera->name());
    const Camera::Format format = camera->format();
    const double given = format.frames_per_s / (format.is_interlaced ? 2 : 1);
    if (asked > 0 && given > 0 && std::abs(given - asked) > 0.02 * asked)
      out.push_back("camera \"" + camera->name() + "\": asked for " + shortest(asked) +
                    " frames a second, it gives " + shortest(given));
  }
  return out;
}

Rig open_rig(const Config& config, const std::function<void(const std::string&)>& warn) {
  const RigSettings settings = rig_settings(config);
  auto cameras = open_cameras(config, true);
  check_frame_memory(config, cameras,
                     std::vector<std::size_t>(cameras.size(), settings.ring_slots));
  std::ranges::for_each(warnings_of(config, cameras), warn);
  return Rig(std::move(cameras), settings);
}

}  // namespace throwcal
