// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <memory>
#include <optional>
#include <vector>

#include "estimator/observation.h"
#include "estimator/rig_description.h"

namespace throwcal {

struct FlightFinderSettings {
  double min_flight_s = 0.2;
  int min_sightings = 8;
};

/// Finds what flies in one camera's stream of ball-like blobs, by the fit itself: a thing that
/// moves as gravity says is the ball. Knows nothing of where the camera stands. Rows may hold
/// clutter, several blobs a frame, the ball in the hand, bounces and gaps.
class FlightFinder {
 public:
  FlightFinder(const RigDescription& rig, CameraId camera, FlightFinderSettings settings = {});
  ~FlightFinder();
  FlightFinder(FlightFinder&&) noexcept;

  /// Takes one frame (times ascending) and returns the flights that are over as of this frame,
  /// often none.
  std::vector<Track> add(const FrameSightings& frame);
  /// The first sighting of the oldest flight that is not over yet; nothing: none is followed.
  std::optional<HostTime> following_since() const;
  /// The flights still open at the end of a recording.
  std::vector<Track> finish();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace throwcal
