// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "capture/ball_detector.h"
#include "capture/camera_factory.h"
#include "tests/support/allocation_count.h"

namespace throwcal {
namespace {

TEST(BallDetector, AFrameAllocatesNothingOnceAThrowWasSeen) {
#ifndef COUNTS_ALLOCATIONS
  GTEST_SKIP() << "needs glibc's malloc, without a sanitizer's";
#else
  const SimulatedSceneSettings settings{.seed = 11};
  const auto scene = std::make_shared<const SimulatedScene>(settings);
  CameraSource source;
  source.source = "simulated";
  source.model = scene->rig().cameras[0].model;
  source.scene = scene;
  source.paced = false;
  source.scene_end_s = 9.6;  // four throws, of which the first three are to get to know
  const auto camera = make_camera(source);
  BallDetector detector(source.model, scene->rig().ball.diameter_m);
  std::vector<std::uint8_t> slot(static_cast<std::size_t>(settings.width_px * settings.height_px));
  Frame frame;
  camera->start();
  long allocated = 0;
  std::size_t sightings = 0;
  for (int n = 0; camera->next(slot, frame) == Camera::Outcome::frame; ++n) {
    const long before = allocations;
    const FrameSightings& found = detector.detect(frame);
    if (n < 7 * 60) continue;
    allocated += allocations - before;
    sightings += found.sightings.size();
  }
  EXPECT_GT(sightings, 50u);
  EXPECT_EQ(allocated, 0);
#endif
}

}  // namespace
}  // namespace throwcal
