// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <map>
#include <string>
#include <vector>

#include "tests/support/thrower.h"

namespace throwcal::test {

struct ClutterSettings {
  std::uint64_t seed = 1;
  bool hand = true;    ///< half a second of a swinging hand before every release
  bool bounce = true;  ///< and half a second of flight after a bounce at the end
  bool spots = true;   ///< flickering fixed spots and stray blobs
  bool walker = true;  ///< somebody's head crosses the site at 1.1 m/s
  double miss = 0.1;   ///< fraction of frames in which the ball goes unseen
  bool radius = true;  ///< apparent radius with 4 % noise
};

/// A recording of one camera, unlabelled, and what each sighting (by id) truly is: a throw's name,
/// that name with a "b" for the arc after its bounce, "hand" or "clutter".
struct Stream {
  std::vector<FrameSightings> frames;  ///< every frame, empty ones included
  std::map<std::uint64_t, std::string> truth;
};

/// What one camera of a scene sees of the scene's flights amid clutter. Frame times and clock are
/// the camera's own; the settings must be those that made the scene.
Stream make_stream(const Thrown& scene, const ThrowerSettings& settings, CameraId camera,
                   const ClutterSettings& clutter = {});

}  // namespace throwcal::test
