// SPDX-License-Identifier: BSD-3-Clause
#include "capture/camera_factory.h"

#include <stdexcept>

#include "capture/libcamera.h"
#include "capture/simulated_camera.h"
#include "capture/v4l2_camera.h"
#include "capture/video_camera.h"

namespace throwcal {

std::unique_ptr<Camera> make_camera(const CameraSource& source) {
  constexpr std::string_view video = "video:", v4l2 = "v4l2:", libcamera = "libcamera:";
  if (source.source == "simulated") {
    if (source.scene) return std::make_unique<SimulatedCamera>(source);
    throw std::runtime_error("camera " + source.name + ": simulated, but there is no scene to see");
  }
  if (source.source.starts_with(video))
    return std::make_unique<VideoCamera>(source, source.source.substr(video.size()));
  if (source.source.starts_with(v4l2))
    return std::make_unique<V4l2Camera>(source, source.source.substr(v4l2.size()));
  if (source.source.starts_with(libcamera))
    return make_libcamera_camera(source, source.source.substr(libcamera.size()));
  throw std::runtime_error("camera " + source.name + ": source \"" + source.source +
                           "\" is unknown; expected \"simulated\", \"video:PATH\", "
                           "\"v4l2:DEVICE\" or \"libcamera:ID\"");
}

}  // namespace throwcal
