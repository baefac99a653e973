// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/sightings_check.h"

#include <algorithm>
#include <set>

#include "capture/quotation.h"
#include "firmware/input_error.h"

namespace throwcal {
namespace {

constexpr std::size_t least_sightings = 5;
constexpr std::chrono::seconds longest_flight(20);  ///< 490 m high

void check_cameras(const std::vector<SightingRow>& rows, const RigDescription& rig,
                   const std::string& name) {
  std::set<CameraId> cameras;
  for (const SightingRow& row : rows) cameras.insert(row.sighting.camera);
  if (cameras.size() == 1)
    throw InputError(name + ": all sightings are of camera \"" +
                     rig.cameras[*cameras.begin()].name +
                     "\"; expected those of two cameras or more");
}

void check_duration(const Throw& thrown, const std::string& name) {
  auto first = HostTime::max(), last = HostTime::min();
  for (const Track& track : thrown.tracks) {
    first = std::min(first, track.sightings.front().time);
    last = std::max(last, track.sightings.back().time);
  }
  if (last - first > longest_flight)
    throw InputError(name + ": throw " + in_quotes(thrown.id) + " lasts " +
                     std::to_string(std::chrono::ceil<std::chrono::seconds>(last - first).count()) +
                     " s; expected one flight, 20 s at most");
}

void check_longest(const std::vector<Throw>& throws, const RigDescription& rig,
                   const std::string& name) {
  const Throw* in = nullptr;
  const Track* longest = nullptr;
  for (const Throw& thrown : throws)
    for (const Track& track : thrown.tracks)
      if (!longest || track.sightings.size() > longest->sightings.size())
        in = &thrown, longest = &track;
  if (longest && longest->sightings.size() < least_sightings)
    throw InputError(name + ": the longest throw, " + in_quotes(in->id) + ", has only " +
                     std::to_string(longest->sightings.size()) + " sightings by one camera, \"" +
                     rig.cameras[longest->camera].name +
                     "\"; expected 5 or more, as one camera alone must fix a flight");
}

}  // namespace

void check_usable(const std::vector<SightingRow>& rows, const RigDescription& rig,
                  const std::string& name) {
  check_cameras(rows, rig, name);
  const std::vector<Throw> throws = labelled_throws(rows);
  for (const Throw& thrown : throws) check_duration(thrown, name);
  const bool all_labelled =
      std::ranges::none_of(rows, [](const SightingRow& row) { return row.throw_id.empty(); });
  if (all_labelled) check_longest(throws, rig, name);
}

}  // namespace throwcal
