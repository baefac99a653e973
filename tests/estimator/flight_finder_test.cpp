// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/flight_finder.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>

#include "tests/support/clutter.h"

namespace throwcal {
namespace {

using test::ClutterSettings;
using test::make_stream;
using test::make_thrown;
using test::Stream;
using test::ThrowerSettings;
using test::Thrown;

struct Found {
  std::vector<Track> tracks;
  std::vector<double> delay_s;  ///< from a flight's last sighting to its report
};

Found find(const RigDescription& rig, CameraId camera, const Stream& stream) {
  FlightFinder finder(rig, camera);
  Found out;
  for (const FrameSightings& frame : stream.frames)
    for (Track& track : finder.add(frame)) {
      out.delay_s.push_back(seconds(frame.time - track.sightings.back().time));
      out.tracks.push_back(std::move(track));
    }
  for (Track& track : finder.finish()) out.tracks.push_back(std::move(track));
  return out;
}

struct Judgement {
  std::map<std::string, int> tracks_of;  ///< by what most of a track's sightings truly are
  int sightings = 0, wrong = 0;
};

Judgement judge(const Found& found, const Stream& stream) {
  Judgement out;
  for (const Track& track : found.tracks) {
    std::map<std::string, int> votes;
    for (const BallSighting& s : track.sightings) ++votes[stream.truth.at(s.id)];
    const auto most = std::max_element(votes.begin(), votes.end(),
                                       [](auto& a, auto& b) { return a.second < b.second; });
    ++out.tracks_of[most->first];
    out.sightings += static_cast<int>(track.sightings.size());
    out.wrong += static_cast<int>(track.sightings.size()) - most->second;
  }
  return out;
}

int seen(const Stream& stream, const std::string& what) {
  return static_cast<int>(std::count_if(stream.truth.begin(), stream.truth.end(),
                                        [&](auto& entry) { return entry.second == what; }));
}

void expect_all_found(const Thrown& scene, const Stream& stream, const Judgement& judgement) {
  for (const Throw& thrown : scene.throws) {
    if (seen(stream, thrown.id) < 30) continue;
    EXPECT_EQ(judgement.tracks_of.count(thrown.id), 1u) << "throw " << thrown.id;
  }
  EXPECT_EQ(judgement.tracks_of.count("hand"), 0u);
  EXPECT_EQ(judgement.tracks_of.count("clutter"), 0u);
}

TEST(FlightFinder, EveryFlightIsFoundAmidHandBouncesClutterAndAWalker) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const ThrowerSettings settings{.seed = seed, .throws = 6, .duration_s = 0.8};
    const Thrown scene = make_thrown(settings);
    for (CameraId camera : {0u, 2u}) {
      SCOPED_TRACE(testing::Message() << "seed " << seed << " camera " << camera);
      const Stream stream = make_stream(scene, settings, camera, {.seed = seed});
      const Judgement judgement = judge(find(scene.rig, camera, stream), stream);
      expect_all_found(scene, stream, judgement);
      // One frame of the hand before release is indistinguishable from flight, two nearly so.
      EXPECT_LE(judgement.wrong, 2 * static_cast<int>(judgement.tracks_of.size()));
    }
  }
}

TEST(FlightFinder, ABouncedBallIsTwoFlightsNotOneBentOne) {
  const ThrowerSettings settings{.seed = 4, .throws = 3, .duration_s = 0.7};
  const Thrown scene = make_thrown(settings);
  const Stream stream = make_stream(scene, settings, 1,
                                    {.hand = false, .spots = false, .walker = false, .miss = 0.0});
  const Judgement judgement = judge(find(scene.rig, 1, stream), stream);
  for (const Throw& thrown : scene.throws) {
    if (seen(stream, thrown.id) < 30 || seen(stream, thrown.id + "b") < 20) continue;
    EXPECT_EQ(judgement.tracks_of.at(thrown.id), 1);
    EXPECT_EQ(judgement.tracks_of.at(thrown.id + "b"), 1);
  }
  // The frame of the bounce itself lies on both arcs.
  EXPECT_LE(judgement.wrong, std::ssize(scene.throws));
}

TEST(FlightFinder, NoiseThatIsNotStatedIsMeasured) {
  const ThrowerSettings settings{.seed = 5, .sigma_px = 0.3, .state_sigma = false};
  const Thrown scene = make_thrown(settings);
  const Stream stream = make_stream(scene, settings, 0);
  expect_all_found(scene, stream, judge(find(scene.rig, 0, stream), stream));
}

TEST(FlightFinder, DragDoesNotEatTheEndsOfAFlight) {
  // Table tennis: drag 0.1 /m, not known beforehand.
  const ThrowerSettings settings{.seed = 6, .drag_per_m = 0.1, .estimate_drag = true};
  const Thrown scene = make_thrown(settings);
  const Stream stream =
      make_stream(scene, settings, 0, {.hand = false, .bounce = false, .miss = 0.0});
  const Judgement judgement = judge(find(scene.rig, 0, stream), stream);
  expect_all_found(scene, stream, judgement);
  int expected = 0;
  for (const Throw& thrown : scene.throws) expected += seen(stream, thrown.id);
  EXPECT_GE(judgement.sightings, expected * 95 / 100);
}

TEST(FlightFinder, WithoutApparentRadiusTheFlightsAreStillFound) {
  const ThrowerSettings settings{.seed = 7};
  const Thrown scene = make_thrown(settings);
  const Stream stream = make_stream(scene, settings, 3, {.walker = false, .radius = false});
  const Judgement judgement = judge(find(scene.rig, 3, stream), stream);
  for (const Throw& thrown : scene.throws)
    EXPECT_TRUE(seen(stream, thrown.id) < 30 || judgement.tracks_of.count(thrown.id) == 1);
}

TEST(FlightFinder, AFlightIsReportedWithin300MillisecondsOfItsEnd) {
  for (const double frames_per_s : {25.0, 30.0, 60.0, 100.0}) {
    const ThrowerSettings settings{.seed = 8, .frames_per_s = frames_per_s};
    const Thrown scene = make_thrown(settings);
    const Stream stream = make_stream(scene, settings, 0);
    const Found found = find(scene.rig, 0, stream);
    ASSERT_GE(found.delay_s.size(), 5u) << frames_per_s;
    int late = 0;
    for (const double delay_s : found.delay_s) late += delay_s > 0.3;
    // The first three may wait for what later flights teach: gravity's direction, the drag.
    EXPECT_LE(late, 3) << frames_per_s << " frames/s, " << found.delay_s.size() << " flights";
    EXPECT_TRUE(std::all_of(found.delay_s.end() - 2, found.delay_s.end(), [](double delay_s) {
      return delay_s <= 0.3;
    })) << frames_per_s;
  }
}

TEST(FlightFinder, ARecordingMayPauseForMinutesAndLeaveEmptyFramesOut) {
  const ThrowerSettings settings{.seed = 12, .throws = 4};
  const Thrown scene = make_thrown(settings);
  Stream stream = make_stream(scene, settings, 0, {.spots = false, .walker = false});
  std::erase_if(stream.frames, [](const FrameSightings& f) { return f.sightings.empty(); });
  // Ten minutes between the second throw and the third.
  for (FrameSightings& frame : stream.frames)
    if (frame.time > HostTime(from_seconds(4.2))) {
      frame.time += std::chrono::minutes(10);
      for (BallSighting& s : frame.sightings) s.time = frame.time;
    }
  expect_all_found(scene, stream, judge(find(scene.rig, 0, stream), stream));
}

TEST(FlightFinder, NothingSeenNothingFound) {
  const Thrown scene = make_thrown({.seed = 9});
  FlightFinder finder(scene.rig, 0);
  for (int n = 0; n < 600; ++n)
    EXPECT_TRUE(finder.add({0, HostTime(from_seconds(n / 60.0)), {}}).empty());
  EXPECT_TRUE(finder.finish().empty());
}

TEST(FlightFinder, TheSameStreamGivesTheSameFlights) {
  const ThrowerSettings settings{.seed = 10, .throws = 3};
  const Thrown scene = make_thrown(settings);
  const Stream stream = make_stream(scene, settings, 2);
  const Found once = find(scene.rig, 2, stream), again = find(scene.rig, 2, stream);
  ASSERT_EQ(once.tracks.size(), again.tracks.size());
  for (std::size_t i = 0; i < once.tracks.size(); ++i) {
    ASSERT_EQ(once.tracks[i].sightings.size(), again.tracks[i].sightings.size());
    for (std::size_t k = 0; k < once.tracks[i].sightings.size(); ++k)
      EXPECT_EQ(once.tracks[i].sightings[k].id, again.tracks[i].sightings[k].id);
  }
}

}  // namespace
}  // namespace throwcal
