// SPDX-License-Identifier: BSD-3-Clause
#include "capture/grabber.h"

#include <gtest/gtest.h>

#include <vector>

namespace throwcal {
namespace {

/// A camera that gives what the test says, then ends.
class Scripted : public Camera {
 public:
  struct Step {
    Outcome outcome;
    std::uint64_t sequence = 0;
  };
  explicit Scripted(std::vector<Step> steps) : steps_(std::move(steps)) {}
  const std::string& name() const override { return name_; }
  Format format() const override { return {8, 4, PixelFormat::grey, 60}; }
  CameraModel model() const override { return {.width_px = 8, .height_px = 4}; }
  bool waits_for_reader() const override { return true; }
  void start() override {}
  Outcome next(std::span<std::uint8_t> slot, Frame& frame) override {
    if (at_ == steps_.size()) return Outcome::end;
    const Step step = steps_[at_++];
    frame.sequence = step.sequence;
    frame.image = {slot.data(), 8, 4, 8, PixelFormat::grey};
    return step.outcome;
  }
  void interrupt() override {}
  std::string error() const override { return "was unplugged"; }

 private:
  std::string name_ = "scripted";
  std::vector<Step> steps_;
  std::size_t at_ = 0;
};

using enum Camera::Outcome;

GrabberStats stats_after(std::vector<Scripted::Step> steps, std::size_t frames) {
  Grabber grabber(std::make_unique<Scripted>(std::move(steps)), 4);
  grabber.start();
  std::size_t taken = 0;
  while (grabber.take()) ++taken;
  EXPECT_EQ(taken, frames);
  return grabber.stats();
}

TEST(Grabber, DamagedFramesAreNotLostOnesAndLostOnesNotDamaged) {
  const GrabberStats stats =
      stats_after({{frame, 0}, {damaged, 1}, {frame, 2}, {frame, 5}, {damaged, 7}}, 3);
  EXPECT_EQ(stats.frames_damaged, 2u);
  EXPECT_EQ(stats.frames_lost_by_driver, 3u);
  EXPECT_EQ(stats.error, "");
}

TEST(Grabber, ANumberThatDoesNotGoOnIsNoLoss) {
  EXPECT_EQ(stats_after({{frame, 4}, {damaged, 5}, {frame, 5}, {frame, 5}, {frame, 3}}, 4)
                .frames_lost_by_driver,
            0u);
}

TEST(Grabber, ACameraThatIsBackSaysNothingMoreAndCountsAsOneInterruption) {
  const GrabberStats back = stats_after({{frame, 0}, {lost}, {lost}, {frame, 1}}, 2);
  EXPECT_EQ(back.interruptions, 1u);
  EXPECT_EQ(back.error, "");
  const GrabberStats gone = stats_after({{frame, 0}, {lost}, {lost}}, 1);
  EXPECT_EQ(gone.interruptions, 1u);
  EXPECT_EQ(gone.error, "was unplugged");
}

}  // namespace
}  // namespace throwcal
