// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/throw_assembler.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>

#include "estimator/flight_finder.h"
#include "tests/support/clutter.h"

namespace throwcal {
namespace {

using test::make_stream;
using test::make_thrown;
using test::Stream;
using test::ThrowerSettings;
using test::Thrown;

std::map<std::uint64_t, std::string> truth_of(const Thrown& scene) {
  std::map<std::uint64_t, std::string> out;
  for (const Throw& thrown : scene.throws)
    for (const Track& track : thrown.tracks)
      for (const BallSighting& s : track.sightings) out[s.id] = thrown.id;
  return out;
}

std::vector<Throw> assemble(const Thrown& scene) {
  ThrowAssembler assembler(scene.rig);
  // Last throw first: the order in which tracks come in must not matter.
  for (auto thrown = scene.throws.rbegin(); thrown != scene.throws.rend(); ++thrown)
    for (const Track& track : thrown->tracks)
      if (track.sightings.size() >= 15) assembler.add(track);
  return assembler.assemble();
}

/// Every throw is whole and pure: one true throw, all cameras that saw it well.
void expect_the_true_throws(const Thrown& scene, const std::vector<Throw>& throws) {
  const auto truth = truth_of(scene);
  ASSERT_EQ(throws.size(), scene.throws.size());
  for (std::size_t j = 0; j < throws.size(); ++j) {
    EXPECT_EQ(throws[j].id, std::to_string(j + 1));
    const auto well =
        std::count_if(scene.throws[j].tracks.begin(), scene.throws[j].tracks.end(),
                      [](const Track& track) { return track.sightings.size() >= 15; });
    EXPECT_EQ(std::ssize(throws[j].tracks), well) << "throw " << j + 1;
    for (const Track& track : throws[j].tracks)
      for (const BallSighting& s : track.sightings) {
        EXPECT_EQ(truth.at(s.id), scene.throws[j].id);
        EXPECT_EQ(s.camera, track.camera);
      }
  }
}

TEST(ThrowAssembler, TracksOfSynchronisedCamerasBecomeTheirThrows) {
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    SCOPED_TRACE(testing::Message() << "seed " << seed);
    const Thrown scene = make_thrown({.seed = seed});
    expect_the_true_throws(scene, assemble(scene));
  }
}

TEST(ThrowAssembler, FreeRunningClocksDoNotMatter) {
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    SCOPED_TRACE(testing::Message() << "seed " << seed);
    const Thrown scene = make_thrown({.seed = seed,
                                      .state_sigma = false,
                                      .max_offset_s = 0.015,
                                      .drag_per_m = 0.0175,
                                      .estimate_drag = true});
    expect_the_true_throws(scene, assemble(scene));
  }
}

TEST(ThrowAssembler, OneThrowIsEnough) {
  const Thrown scene = make_thrown({.seed = 5, .throws = 1, .max_offset_s = 0.015});
  expect_the_true_throws(scene, assemble(scene));
}

TEST(ThrowAssembler, TheFirstCameraNeedNotSeeEveryThrow) {
  Thrown scene = make_thrown({.seed = 6, .throws = 4});
  for (Throw& thrown : scene.throws)
    std::erase_if(thrown.tracks, [](const Track& track) { return track.camera == 0; });
  expect_the_true_throws(scene, assemble(scene));
}

TEST(ThrowAssembler, TwoBallsInTheAirAreNotMixed) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    SCOPED_TRACE(testing::Message() << "seed " << seed);
    Thrown scene = make_thrown({.seed = seed, .throws = 6, .max_offset_s = 0.015});
    // Every second throw is moved to 30 ms after the one before it, in all cameras alike.
    for (std::size_t j = 1; j < scene.throws.size(); j += 2)
      for (Track& track : scene.throws[j].tracks)
        for (BallSighting& s : track.sightings) s.time -= from_seconds(1.97);
    const auto truth = truth_of(scene);
    const std::vector<Throw> throws = assemble(scene);
    EXPECT_EQ(throws.size(), scene.throws.size());
    for (const Throw& thrown : throws) {
      const std::string& first = truth.at(thrown.tracks[0].sightings[0].id);
      for (const Track& track : thrown.tracks)
        for (const BallSighting& s : track.sightings) EXPECT_EQ(truth.at(s.id), first);
    }
  }
}

TEST(ThrowAssembler, WhatNoSecondCameraConfirmsIsLeftOut) {
  Thrown scene = make_thrown({.seed = 7, .throws = 4});
  // Only camera 3 saw the second throw.
  std::erase_if(scene.throws[1].tracks, [](const Track& track) { return track.camera != 2; });
  ASSERT_EQ(scene.throws[1].tracks.size(), 1u);
  const auto truth = truth_of(scene);
  const std::vector<Throw> throws = assemble(scene);
  EXPECT_EQ(throws.size(), 3u);
  for (const Throw& thrown : throws)
    for (const Track& track : thrown.tracks)
      EXPECT_NE(truth.at(track.sightings[0].id), scene.throws[1].id);
}

TEST(ThrowAssembler, PiecesOfOneFlightAreJoined) {
  Thrown scene = make_thrown({.seed = 8, .throws = 3});
  Throw& thrown = scene.throws[1];
  Track second = thrown.tracks[0];
  Track& first = thrown.tracks[0];
  second.sightings.erase(second.sightings.begin(), second.sightings.begin() + 20);
  first.sightings.resize(20);
  const CameraId camera = first.camera;
  thrown.tracks.push_back(second);  // `first` may be gone
  const std::vector<Throw> throws = assemble(scene);
  ASSERT_EQ(throws.size(), 3u);
  EXPECT_EQ(std::count_if(throws[1].tracks.begin(), throws[1].tracks.end(),
                          [&](const Track& track) { return track.camera == camera; }),
            1);
  for (const Track& track : throws[1].tracks)
    if (track.camera == camera) {
      EXPECT_GT(track.sightings.size(), 40u);
    }
}

TEST(ThrowAssembler, FromCandidatesAmidHandBounceAndClutterToThrows) {
  const ThrowerSettings settings{.seed = 9, .throws = 4, .max_offset_s = 0.015, .duration_s = 0.8};
  const Thrown scene = make_thrown(settings);
  ThrowAssembler assembler(scene.rig);
  std::vector<Stream> streams;
  for (CameraId camera = 0; camera < 4; ++camera) {
    streams.push_back(make_stream(scene, settings, camera, {.seed = 9}));
    FlightFinder finder(scene.rig, camera);
    for (const FrameSightings& frame : streams.back().frames)
      for (Track& track : finder.add(frame)) assembler.add(std::move(track));
    for (Track& track : finder.finish()) assembler.add(std::move(track));
  }
  std::map<std::string, int> throws_of;
  int used = 0, wrong = 0;
  for (const Throw& thrown : assembler.assemble()) {
    std::map<std::string, int> votes;
    EXPECT_GE(thrown.tracks.size(), 2u);
    for (const Track& track : thrown.tracks)
      for (const BallSighting& s : track.sightings) ++votes[streams[track.camera].truth.at(s.id)];
    const auto most = std::max_element(votes.begin(), votes.end(),
                                       [](auto& a, auto& b) { return a.second < b.second; });
    ++throws_of[most->first];
    for (const auto& [what, count] : votes) {
      used += count;
      wrong += what == most->first ? 0 : count;
    }
  }
  for (const Throw& thrown : scene.throws) EXPECT_EQ(throws_of[thrown.id], 1);
  EXPECT_EQ(throws_of.count("hand") + throws_of.count("clutter"), 0u);
  EXPECT_LE(100 * wrong, used);  // at most 1 %
}

// What is partly hidden where a flight begins or ends is seen before a hand.
TEST(ThrowAssembler, SightingsOfHiddenBallsAtAThrowsEdgesAreLeftOut) {
  Thrown scene = make_thrown({.seed = 7});
  std::set<std::uint64_t> at_edges, inside;
  for (Throw& thrown : scene.throws)
    for (Track& track : thrown.tracks) {
      const std::size_t n = track.sightings.size();
      if (n < 20) continue;
      for (const std::size_t i : {std::size_t{0}, std::size_t{1}, std::size_t{2}, n - 1}) {
        track.sightings[i].is_partial = true;
        at_edges.insert(track.sightings[i].id);
      }
      track.sightings[n / 2].is_partial = true;
      inside.insert(track.sightings[n / 2].id);
    }
  ASSERT_FALSE(at_edges.empty());
  const std::vector<Throw> throws = assemble(scene);
  ASSERT_EQ(throws.size(), scene.throws.size());
  for (const Throw& thrown : throws)
    for (const Track& track : thrown.tracks)
      for (const BallSighting& s : track.sightings) {
        EXPECT_FALSE(at_edges.contains(s.id));
        inside.erase(s.id);
      }
  EXPECT_TRUE(inside.empty()) << "hidden only for a moment: still of use";
}

std::vector<std::vector<std::uint64_t>> sightings_of(const std::vector<Throw>& throws) {
  std::vector<std::vector<std::uint64_t>> out;
  for (const Throw& thrown : throws)
    for (const Track& track : thrown.tracks) {
      out.emplace_back();
      for (const BallSighting& s : track.sightings) out.back().push_back(s.id);
    }
  return out;
}

// A box puts them together after each; whoever repeats it, once.
TEST(ThrowAssembler, WhatItKnowsOfEarlierTracksChangesNothing) {
  for (const bool state_sigma : {true, false}) {
    Thrown scene = make_thrown({.seed = 3, .throws = 20, .state_sigma = state_sigma});
    // A hand's last frame at some edges, so that there is something to cut.
    for (std::size_t j = 0; j < scene.throws.size(); j += 3)
      for (Track& track : scene.throws[j].tracks) track.sightings.front().center_px.x() += 3.0;
    ThrowAssembler again_and_again(scene.rig);
    std::vector<Throw> last;
    std::vector<Track> so_far;
    for (const Throw& thrown : scene.throws) {
      for (const Track& track : thrown.tracks) {
        again_and_again.add(track);
        so_far.push_back(track);
      }
      last = again_and_again.assemble();
      ThrowAssembler once(scene.rig);
      for (const Track& track : so_far) once.add(track);
      ASSERT_EQ(sightings_of(last), sightings_of(once.assemble())) << so_far.size() << " tracks";
    }
    EXPECT_EQ(last.size(), scene.throws.size());
  }
}

TEST(ThrowAssembler, NoTracksNoThrows) {
  EXPECT_TRUE(ThrowAssembler(make_thrown({}).rig).assemble().empty());
}

}  // namespace
}  // namespace throwcal
