// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/estimator_thread.h"

#include <gtest/gtest.h>
#include <poll.h>

#include "tests/support/simulated_cameras.h"

namespace throwcal {
namespace {

using namespace std::chrono_literals;

constexpr double scene_s = 6.0;  // two throws

News wait_for(NewsBox& box) {
  pollfd news{box.fd(), POLLIN, 0};
  EXPECT_EQ(poll(&news, 1, 60'000), 1) << "no news within a minute";
  return box.take();
}

/// The flights of a session that begins and ends now.
std::size_t flights_of_a_session(EstimatorThread& estimator, NewsBox& box) {
  estimator.begin_session(1);
  estimator.finish_session();
  std::size_t flights = 0;
  for (;;) {
    const News news = wait_for(box);
    flights += news.flights.size();
    if (news.solved) return flights;
  }
}

/// Sessions that begin only when all has been seen, one after the other.
std::vector<std::size_t> flights_seen_before(HostClock::duration pre_trigger, int sessions) {
  const auto scene = std::make_shared<const SimulatedScene>(SimulatedSceneSettings{
      .seed = 2, .cameras = 2, .width_px = 320, .height_px = 240, .focal_px = 240});
  Rig rig(test::simulated_cameras(2, scene, scene_s), {});
  NewsBox box;
  EstimatorThread estimator(scene->rig(), rig, box, pre_trigger);
  rig.start();
  while (!wait_for(box).cameras_ended) {
  }
  std::vector<std::size_t> flights;
  for (int i = 0; i < sessions; ++i) flights.push_back(flights_of_a_session(estimator, box));
  return flights;
}

TEST(EstimatorThread, AThrowBeforeTheCaptureBeganBelongsToItOnce) {
  const auto flights = flights_seen_before(10s, 2);
  EXPECT_GE(flights[0], 2u);
  EXPECT_EQ(flights[1], 0u) << "another session had them";
}

TEST(EstimatorThread, WhatWasSeenLongBeforeTheCaptureDoesNotCount) {
  EXPECT_EQ(flights_seen_before(0s, 1).at(0), 0u);
}

}  // namespace
}  // namespace throwcal
