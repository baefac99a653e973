// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <memory>
#include <string>
#include <vector>

#include "capture/camera_factory.h"

namespace throwcal::test {

/// A camera of the scene, as fast as it is looked at.
inline CameraSource simulated_source(CameraId id,
                                     const std::shared_ptr<const SimulatedScene>& scene) {
  CameraSource source;
  source.id = id;
  source.name = "cam" + std::to_string(id + 1);
  source.source = "simulated";
  source.model = scene->rig().cameras.at(id).model;
  source.scene = scene;
  source.paced = false;
  return source;
}

/// The first so many of the scene, which end after a time.
inline std::vector<std::unique_ptr<Camera>> simulated_cameras(
    CameraId count, const std::shared_ptr<const SimulatedScene>& scene, double scene_end_s) {
  std::vector<std::unique_ptr<Camera>> cameras;
  for (CameraId id = 0; id < count; ++id) {
    CameraSource source = simulated_source(id, scene);
    source.scene_end_s = scene_end_s;
    cameras.push_back(make_camera(source));
  }
  return cameras;
}

}  // namespace throwcal::test
