// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/previews.h"

#include <gtest/gtest.h>

#include "tests/support/simulated_cameras.h"

namespace throwcal {
namespace {

using namespace std::chrono_literals;

TEST(Previews, AreOfTheNewestFrameWithItsBallsAndMadeOnceForAll) {
  const auto scene = std::make_shared<const SimulatedScene>(SimulatedSceneSettings{
      .seed = 2, .cameras = 2, .width_px = 160, .height_px = 120, .focal_px = 120});
  Rig rig(test::simulated_cameras(2, scene, 1.0), {});
  Previews previews(rig);
  const Previews::Clock::time_point now{};
  EXPECT_FALSE(previews.newest(0, now)) << "before the first frame";
  rig.start();
  std::size_t balls = 0;
  while (const auto frame = rig.next({}))
    if (frame->camera == 0) balls = frame->sightings.size();
  const auto first = previews.newest(0, now);
  ASSERT_TRUE(first);
  EXPECT_EQ(first->jpeg.substr(0, 2), "\xff\xd8");
  EXPECT_EQ(first->balls.empty(), balls == 0);
  EXPECT_EQ(previews.newest(0, now + 1ms), first);
  EXPECT_EQ(previews.newest(0, now + 10s), first) << "there is no newer frame";
  EXPECT_NE(previews.newest(1, now + 1ms), first);
}

}  // namespace
}  // namespace throwcal
