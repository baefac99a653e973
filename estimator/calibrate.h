// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <functional>
#include <vector>

#include "estimator/calibration.h"
#include "estimator/fit_memory.h"
#include "estimator/observation.h"
#include "estimator/rig_description.h"

namespace throwcal {

/// A start in place of the closed form: a calibration's poses and offsets, in the rig's order.
struct Guess {
  std::vector<Rigid> T_world_cam;
  std::vector<double> time_offset_s;
  double drag_per_m = 0.0;
};

struct CalibrateSettings {
  Method method = Method::full;
  int throw_iterations = 30;  ///< of the filters: sweeps over all throws
  std::optional<Guess> guess;
  std::function<void(double fraction_done)>
      progress;  ///< called now and then from the same thread, 0 to 1
  /// What was fitted for the call before; with the same rig and a throw more it is the same result,
  /// sooner.
  FitMemory* fits = nullptr;
};

/// The one door: from throws to every camera's position and orientation. Never throws on what the
/// data say: a failure is a verdict with its reasons. The same throws in, the same bits out.
Calibration calibrate(const RigDescription& rig, const std::vector<Throw>& throws,
                      const CalibrateSettings& settings = {});

}  // namespace throwcal
