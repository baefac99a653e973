// SPDX-License-Identifier: BSD-3-Clause
#include "capture/simulated_camera.h"

#include <gtest/gtest.h>

#include <cmath>
#include <thread>

namespace throwcal {
namespace {

constexpr int width = 320, height = 240;

CameraSource source_of(const SimulatedSceneSettings& settings, CameraId id) {
  CameraSource source;
  source.id = id;
  source.source = "simulated";
  source.scene = std::make_shared<const SimulatedScene>(settings);
  source.model = source.scene->rig().cameras.at(id).model;
  source.paced = false;
  return source;
}

class SimulatedCameraTest : public testing::Test {
 protected:
  SimulatedSceneSettings settings_{
      .seed = 9, .width_px = width, .height_px = height, .focal_px = 240};
  std::vector<std::uint8_t> slot_ = std::vector<std::uint8_t>(width * height), other_ = slot_;
  Frame frame_;
};

TEST_F(SimulatedCameraTest, RendersTheSameFramesForTheSameSeed) {
  SimulatedCamera one(source_of(settings_, 1)), same(source_of(settings_, 1));
  for (int n = 0; n < 90; ++n) {
    ASSERT_EQ(one.next(slot_, frame_), Camera::Outcome::frame);
    ASSERT_EQ(same.next(other_, frame_), Camera::Outcome::frame);
    ASSERT_EQ(slot_, other_) << "frame " << n;
  }
}

TEST_F(SimulatedCameraTest, StampsFramesByItsOwnClock) {
  CameraSource source = source_of(settings_, 2);
  source.scene_start = HostTime(std::chrono::seconds(1000));
  SimulatedCamera camera(source);
  for (std::uint64_t n = 0; n < 3; ++n) {
    ASSERT_EQ(camera.next(slot_, frame_), Camera::Outcome::frame);
    EXPECT_EQ(frame_.sequence, n);
    const double true_s = source.scene->frame_phase_s(2) + static_cast<double>(n) / 60;
    EXPECT_NEAR(
        seconds(frame_.row0_mid_exposure - source.scene_start) + source.scene->time_offset_s(2),
        true_s, 1e-8);
  }
}

// Variance of the difference of two frames of a still scene is twice that of one.
TEST_F(SimulatedCameraTest, HasASensorsNoiseThatDoesNotRepeat) {
  SimulatedCamera camera(source_of(settings_, 0));
  camera.next(slot_, frame_);
  for (int n = 0; n < 10; ++n) {
    camera.next(other_, frame_);
    double sum = 0, squares = 0, level = 0;
    for (std::size_t i = 0; i < slot_.size(); ++i) {
      const double difference = static_cast<double>(slot_[i]) - other_[i];
      sum += difference;
      squares += difference * difference;
      level += slot_[i];
    }
    const auto pixels = static_cast<double>(slot_.size());
    const double variance = 1.6 * 1.6 + 0.03 * level / pixels + 1.0 / 12;  // rounding's, too
    EXPECT_NEAR(sum / pixels, 0.0, 0.05);
    EXPECT_NEAR(squares / pixels / (2 * variance), 1.0, 0.05);
  }
}

TEST_F(SimulatedCameraTest, EndsWhereItIsToldTo) {
  CameraSource source = source_of(settings_, 0);
  source.scene_end_s = 0.5;
  SimulatedCamera camera(source);
  int frames = 0;
  while (camera.next(slot_, frame_) == Camera::Outcome::frame) ++frames;
  EXPECT_EQ(frames, 30);
}

TEST_F(SimulatedCameraTest, InterruptWakesAPacedCameraThatWaits) {
  CameraSource source = source_of(settings_, 0);
  source.paced = true;
  source.scene_start =
      HostTime((std::chrono::steady_clock::now() + std::chrono::hours(1)).time_since_epoch());
  SimulatedCamera camera(source);
  camera.start();
  std::thread other([&] { camera.interrupt(); });
  EXPECT_EQ(camera.next(slot_, frame_), Camera::Outcome::interrupted);
  other.join();
}

// A scene that began long ago: a live camera joins it where it is, and what its reader then misses
// shows as a gap.
TEST_F(SimulatedCameraTest, PacedJoinsTheSceneWhereItIs) {
  CameraSource source = source_of(settings_, 0);
  source.paced = true;
  source.scene_start =
      HostTime((std::chrono::steady_clock::now() - std::chrono::seconds(100)).time_since_epoch());
  SimulatedCamera camera(source);
  camera.start();
  ASSERT_EQ(camera.next(slot_, frame_), Camera::Outcome::frame);
  EXPECT_GE(frame_.sequence, 100u * 60u - 1u);
  CameraSource late = source;
  SimulatedCamera behind(late);  // never started: its next frame is number 0, 6000 frames late
  ASSERT_EQ(behind.next(slot_, frame_), Camera::Outcome::frame);
  EXPECT_GE(frame_.sequence, 100u * 60u - 10u);
}

}  // namespace
}  // namespace throwcal
