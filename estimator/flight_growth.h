// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <optional>
#include <span>
#include <vector>

#include "estimator/candidate_history.h"

namespace throwcal {

/// What is known of flights before the next one: the rig's ball, and what earlier flights told.
struct FlightKnowledge {
  double gravity_mps2 = 9.80665;
  std::optional<GravityEstimate> gravity;  ///< in this camera's axes, once flights agree on it
  double drag_per_m = 0.0;
  double sigma_drag_per_m = 0.0;  ///< 0: known
  double noise_scale = 1.0;       ///< true noise over stated noise
  /// What fourth differences do not see, added in quadrature [px]: a detector's errors that last
  /// from frame to frame, as over a background as bright as the ball.
  double slow_error_px = 0.0;
};

/// Candidates that obey one flight, times ascending.
struct GrownFlight {
  std::vector<CandidateRef> points;
  CameraFlight fit;  ///< `used` has a flag for each point; after growth all are used
};

/// Whether a few smoothly linked candidates are a flight: fits, chi2, in front of the camera, not
/// faster than a throw, distance known and in keeping with the ball's apparent size.
std::optional<GrownFlight> seed_flight(const CandidateHistory& history,
                                       std::span<const CandidateRef> points,
                                       const FlightKnowledge& knowledge);

/// Adds what the flight predicts, frame by frame outwards from both ends and in its gaps, and fits
/// again, until nothing more belongs. Candidates already taken are left alone.
void grow_flight(const CandidateHistory& history, const FlightKnowledge& knowledge,
                 GrownFlight& flight);

/// The ends of a flight that is over. Takes off what belongs to the hand, a bounce or a branch: the
/// outermost points whose cost is more than chance allows; grows again, also from without the first
/// or last few points, which may have bent the fit so that it went no further.
void settle_flight(const CandidateHistory& history, const FlightKnowledge& knowledge,
                   GrownFlight& flight);

/// Whether two flights are pieces of one: then the first becomes their union. Pieces arise where a
/// few points of the hand bent the first one's fit.
bool merge_flights(const CandidateHistory& history, const FlightKnowledge& knowledge,
                   GrownFlight& flight, const GrownFlight& other);

/// Whether nothing was seen near where a flight came from (at its front) or went to, in the frames
/// just beyond that end.
bool is_clear_beyond(const CandidateHistory& history, const GrownFlight& flight, bool front);

/// The seed's tests on a whole flight.
bool is_plausible(const CandidateHistory& history, const GrownFlight& flight);

}  // namespace throwcal
