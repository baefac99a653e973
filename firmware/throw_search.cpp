// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/throw_search.h"

#include <algorithm>
#include <iterator>
#include <utility>

namespace throwcal {

void SightingNumbering::number(FrameSightings& frame) {
  for (BallSighting& sighting : frame.sightings)
    sighting.id = (std::uint64_t{frame.camera} << 40) + ++counts_.at(frame.camera);
}

ThrowSearch::ThrowSearch(const RigDescription& rig) : assembler_(rig) {
  for (CameraId id = 0; id < rig.cameras.size(); ++id) finders_.emplace_back(rig, id);
}

std::vector<Track> ThrowSearch::keep(std::vector<Track> flights) {
  for (const Track& flight : flights) add_flight(flight);
  return flights;
}

void ThrowSearch::add_flight(Track flight) {
  assembler_.add(flight);
  ++flights_;
}

std::vector<Track> ThrowSearch::add(const FrameSightings& frame) {
  return keep(finders_.at(frame.camera).add(frame));
}

bool ThrowSearch::is_following_since_before(HostTime time) const {
  return std::ranges::any_of(finders_, [&](const FlightFinder& finder) {
    const auto since = finder.following_since();
    return since && *since < time;
  });
}

std::vector<Track> ThrowSearch::finish() {
  std::vector<Track> open;
  for (FlightFinder& finder : finders_)
    std::ranges::move(finder.finish(), std::back_inserter(open));
  return keep(std::move(open));
}

std::vector<Throw> find_throws(const RigDescription& rig,
                               const std::function<std::optional<FrameSightings>()>& next_frame) {
  ThrowSearch search(rig);
  while (const auto frame = next_frame()) search.add(*frame);
  search.finish();
  return search.throws();
}

}  // namespace throwcal
