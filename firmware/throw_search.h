// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "estimator/flight_finder.h"
#include "estimator/throw_assembler.h"

namespace throwcal {

/// Gives each sighting its id: a running count of its camera's, so that it does not matter whose
/// thread was faster.
class SightingNumbering {
 public:
  explicit SightingNumbering(std::size_t cameras) : counts_(cameras) {}
  void number(FrameSightings& frame);

 private:
  std::vector<std::uint64_t> counts_;
};

/// From frames to throws: a flight finder a camera, and what puts their flights together.
class ThrowSearch {
 public:
  explicit ThrowSearch(const RigDescription& rig);

  /// Takes a frame of any camera (those of one camera in order of time); returns the flights that
  /// are over.
  std::vector<Track> add(const FrameSightings& frame);
  /// The flights that were still open; nothing may be added to any camera after it.
  std::vector<Track> finish();
  /// Whether some camera follows a flight that began before `time` and is not over yet.
  bool is_following_since_before(HostTime time) const;
  std::size_t flights() const { return flights_; }  ///< so far
  /// A flight found earlier, as after a restart.
  void add_flight(Track flight);
  std::vector<Throw> throws() { return assembler_.assemble(); }  ///< so far

 private:
  std::vector<Track> keep(std::vector<Track> flights);

  std::vector<FlightFinder> finders_;
  ThrowAssembler assembler_;
  std::size_t flights_ = 0;
};

/// All throws of a recording: this is how frames become throws. `next_frame` hands out every
/// camera's frames, each camera's in order of time, and nothing at the end.
std::vector<Throw> find_throws(const RigDescription& rig,
                               const std::function<std::optional<FrameSightings>()>& next_frame);

}  // namespace throwcal
