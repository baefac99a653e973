// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <memory>
#include <string>
#include <vector>

#include "capture/camera.h"
#include "capture/device_wishes.h"
#include "capture/simulated_scene.h"
#include "estimator/camera_model.h"

namespace throwcal {

/// Which serial number the rig has under which name.
struct NamedSerial {
  std::string serial, camera;
};

/// What a camera's `source` key means: "simulated", "video:PATH" (PATH.timestamps.txt beside it
/// gives frame times), "v4l2:DEVICE", or "libcamera:ID" (an id, a number, or nothing: the only
/// one).
struct CameraSource {
  CameraId id = 0;
  std::string name, source;
  CameraModel model;
  DeviceWishes device{};
  /// A device that is not there is waited for, and another in its place told by the camera's
  /// error(); else make_camera() throws.
  bool may_be_missing = false;
  std::vector<NamedSerial> others{};  ///< to name it where cables are swapped
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
