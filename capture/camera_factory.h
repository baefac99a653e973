// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <memory>
#include <string>

#include "capture/camera.h"
#include "capture/simulated_scene.h"
#include "estimator/camera_model.h"

namespace throwcal {

/// What is wanted of a V4L2 camera beside its picture's size.
struct V4l2Wishes {
  double frames_per_s = 0.0;    ///< 0: as the driver is set
  std::string fourcc;           ///< "YUYV"; empty: the cheapest that serves
  std::string input, standard;  ///< of an analog card: "Composite 0", "PAL"; empty: as it is set
};

/// What a camera's `source` key means: "simulated", "video:PATH" (PATH.timestamps.txt beside it
/// gives frame times), or "v4l2:DEVICE".
struct CameraSource {
  CameraId id = 0;
  std::string name, source;
  CameraModel model;
  V4l2Wishes v4l2{};
  bool colour = false;  ///< deliver colour where there is any; else the luma is enough
  bool paced = true;    ///< deliver frames when they are due; false: as fast as they are taken
  std::shared_ptr<const SimulatedScene>
      scene;                 ///< of simulated cameras; shared, so that all see one ball
  HostTime scene_start{};    ///< when the scene's time 0 is
  double scene_end_s = 0.0;  ///< simulated cameras end here; 0: never
};

/// The driver that a source asks for. Throws std::runtime_error (cause, path, what was tried) where
/// it can't be had. A new driver is one more .cpp and one more line here.
std::unique_ptr<Camera> make_camera(const CameraSource& source);

}  // namespace throwcal
