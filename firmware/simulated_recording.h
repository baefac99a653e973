// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <vector>

#include "capture/simulated_scene.h"
#include "firmware/export.h"
#include "firmware/sightings_file.h"

namespace throwcal {

struct SimulatedRecordingSettings {
  int throws = 5;
  double sigma_px = 0.2;  ///< noise of a centroid's coordinate
  /// Without labels a detector's whole output: the ball in the hand and after the bounce, the hand
  /// itself, and blobs that are none.
  bool labelled = true;
};

/// True time at which the recording's last throw is over, its bounce included.
double end_of_recording_s(const SimulatedScene& scene, int throws);

/// What the scene's cameras would report, seeded by the scene: the same settings, the same rows.
std::vector<SightingRow> simulated_sightings(const SimulatedScene& scene,
                                             const SimulatedRecordingSettings& settings);

/// What a perfect calibration would say: cameras (T_world_cam, time_offset_s), throws, drag_per_m.
Json truth_document(const SimulatedScene& scene, int throws);

/// Of footage: for each camera by name the frames that show the ball before a true time: `frame`
/// (from 0), `time_s` (its own clock's), `u_px`, `v_px` (the projection of the ball's centre when
/// its row is exposed), `radius_px`, `is` ("hand", "2", or "2b" after its bounce) and
/// `fully_inside`.
Json true_frames(const SimulatedScene& scene, double end_s);

}  // namespace throwcal
