// SPDX-License-Identifier: BSD-3-Clause
#include "capture/rig.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <map>
#include <thread>

#include "tests/support/simulated_cameras.h"

namespace throwcal {
namespace {

/// Small pictures: these tests are about threads.
SimulatedSceneSettings small_scene() {
  return {.seed = 2, .cameras = 3, .width_px = 160, .height_px = 120, .focal_px = 120};
}

/// A camera that breaks after some frames: it has failed, or is lost for good.
class BreakingCamera : public Camera {
 public:
  explicit BreakingCamera(std::uint64_t frames, Outcome how = Outcome::failed)
      : how_(how), left_(frames) {}
  const std::string& name() const override { return name_; }
  Format format() const override { return {32, 24, PixelFormat::grey, 60}; }
  CameraModel model() const override { return {.width_px = 32, .height_px = 24}; }
  bool waits_for_reader() const override { return true; }
  void start() override {}
  Outcome next(std::span<std::uint8_t> slot, Frame& frame) override {
    if (is_interrupted_) return Outcome::interrupted;
    if (left_ == 0) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
      return how_;
    }
    --left_;
    frame.sequence = sequence_ += 2;  // every second frame is lost
    frame.image = {slot.data(), 32, 24, 32, PixelFormat::grey};
    return Outcome::frame;
  }
  void interrupt() override { is_interrupted_ = true; }
  std::string error() const override { return "the cable came off"; }

 private:
  const Outcome how_;
  std::atomic<bool> is_interrupted_ = false;
  std::string name_ = "loose";
  std::uint64_t left_, sequence_ = 0;
};

TEST(Rig, HandsOutEveryFrameOfUnpacedCamerasInOrderAndThenEnds) {
  const auto scene = std::make_shared<const SimulatedScene>(small_scene());
  Rig rig(test::simulated_cameras(3, scene, 2.0), {.ring_slots = 4, .queue_frames = 8});
  rig.start();
  std::map<CameraId, std::vector<HostTime>> times;
  while (const auto frame = rig.next({})) times[frame->camera].push_back(frame->time);
  for (CameraId id = 0; id < 3; ++id) {
    ASSERT_EQ(times[id].size(), 120u);
    for (std::size_t n = 1; n < times[id].size(); ++n)
      EXPECT_NEAR(seconds(times[id][n] - times[id][n - 1]), 1.0 / 60, 2e-9);
  }
  EXPECT_EQ(rig.sightings_dropped(), 0u);
  for (const CameraStats& stats : rig.stats()) {
    EXPECT_EQ(stats.frames, 120u);
    EXPECT_EQ(stats.frames_dropped + stats.frames_lost_by_driver, 0u);
    EXPECT_FALSE(stats.running);
    EXPECT_EQ(stats.error, "");
  }
}

TEST(Rig, ACameraThatFailsSaysWhyAndTheOthersGoOn) {
  const auto scene = std::make_shared<const SimulatedScene>(small_scene());
  CameraSource source = test::simulated_source(0, scene);
  source.scene_end_s = 1.0;
  std::vector<std::unique_ptr<Camera>> cameras;
  cameras.push_back(make_camera(source));
  cameras.push_back(std::make_unique<BreakingCamera>(5));
  Rig rig(std::move(cameras), {});
  rig.start();
  int frames = 0;
  while (rig.next({})) ++frames;
  EXPECT_EQ(frames, 60 + 5);
  const CameraStats broken = rig.stats()[1];
  EXPECT_EQ(broken.error, "the cable came off");
  EXPECT_FALSE(broken.running);
  EXPECT_EQ(broken.frames, 5u);
  EXPECT_EQ(broken.frames_lost_by_driver, 4u);
  EXPECT_EQ(rig.stats()[0].error, "");
}

TEST(Rig, ACameraThatIsLostIsNotSaidToRun) {
  std::vector<std::unique_ptr<Camera>> cameras;
  cameras.push_back(std::make_unique<BreakingCamera>(2, Camera::Outcome::lost));
  Rig rig(std::move(cameras), {});
  rig.start();
  EXPECT_TRUE(rig.next({}));
  EXPECT_TRUE(rig.next({}));
  while (rig.stats()[0].error.empty()) std::this_thread::yield();
  EXPECT_EQ(rig.stats()[0].error, "the cable came off");
  EXPECT_FALSE(rig.stats()[0].running);
  EXPECT_EQ(rig.stats()[0].interruptions, 1u);
}

TEST(Rig, StopsWhileCamerasWaitForLightAndTheQueueIsFull) {
  const auto scene = std::make_shared<const SimulatedScene>(small_scene());
  std::vector<std::unique_ptr<Camera>> cameras;
  cameras.push_back(
      make_camera(test::simulated_source(0, scene)));  // endless, and soon waits for the queue
  CameraSource paced = test::simulated_source(1, scene);
  paced.paced = true;
  paced.scene_start =
      HostTime((std::chrono::steady_clock::now() + std::chrono::hours(1)).time_since_epoch());
  cameras.push_back(make_camera(paced));  // its first frame is due in an hour
  Rig rig(std::move(cameras), {.ring_slots = 2, .queue_frames = 3});
  rig.start();
  EXPECT_TRUE(rig.next({}));
  rig.stop();  // or this test never ends
  for (const CameraStats& stats : rig.stats()) EXPECT_FALSE(stats.running);
  while (rig.next({})) continue;
}

TEST(Rig, NextGivesUpWhenStopIsRequested) {
  const auto scene = std::make_shared<const SimulatedScene>(small_scene());
  CameraSource paced = test::simulated_source(0, scene);
  paced.paced = true;
  paced.scene_start =
      HostTime((std::chrono::steady_clock::now() + std::chrono::hours(1)).time_since_epoch());
  std::vector<std::unique_ptr<Camera>> cameras;
  cameras.push_back(make_camera(paced));
  Rig rig(std::move(cameras), {});
  rig.start();
  std::jthread reader([&](std::stop_token stop) { EXPECT_FALSE(rig.next(stop)); });
  reader.request_stop();
}

TEST(Rig, GivesACamerasNewestFrameByReference) {
  const auto scene = std::make_shared<const SimulatedScene>(small_scene());
  Rig rig(test::simulated_cameras(2, scene, 0.2), {});
  EXPECT_FALSE(rig.newest(1));
  rig.start();
  std::vector<HostTime> seen;
  while (const auto frame = rig.next({}))
    if (frame->camera == 1) seen.push_back(frame->time);
  ASSERT_GE(seen.size(), 4u);
  const auto newest = rig.newest(1);
  ASSERT_TRUE(newest);
  EXPECT_EQ(newest->frame().row0_mid_exposure, seen.back());
  EXPECT_EQ(newest->frame().camera, 1u);
  EXPECT_EQ(newest->frame().image.width_px, 160);
  EXPECT_EQ(rig.last_sightings(1).time, seen.back());
}

}  // namespace
}  // namespace throwcal
