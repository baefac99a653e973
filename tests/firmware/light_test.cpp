// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/light.h"

#include <gtest/gtest.h>
#include <linux/gpio.h>

#include <cerrno>

#include "firmware/text_file.h"

namespace throwcal {
namespace {

using namespace std::chrono_literals;

/// A rhythm's steps as they are set, until so many came.
class PlayedRhythm : public testing::Test {
 protected:
  std::vector<bool> next(std::size_t count) {
    wanted_ = count;
    set_.clear();
    loop_.run();
    return set_;
  }

  EventLoop loop_;
  std::size_t wanted_ = 0;
  std::vector<bool> set_;
  Rhythm rhythm_{loop_, [this](bool on) {
                   set_.push_back(on);
                   if (set_.size() == wanted_) loop_.quit();
                 }};
};

using Steps = std::vector<bool>;

TEST_F(PlayedRhythm, GoesOnAndOffAgainAndAgain) {
  rhythm_.repeat({2, 1});
  EXPECT_EQ(set_, Steps{true}) << "at once";
  EXPECT_EQ(next(5), (Steps{false, true, false, true, false}));
}

TEST_F(PlayedRhythm, ANewOneBeginsAtOnceTheSameGoesOn) {
  rhythm_.repeat({1, 600'000});
  rhythm_.repeat({1, 600'000});
  EXPECT_EQ(set_, Steps{true}) << "it is shown already";
  rhythm_.repeat({600'000});
  EXPECT_EQ(set_, (Steps{true, true}));
}

TEST_F(PlayedRhythm, WhatComesOnceIsFollowedByWhatWasRepeated) {
  rhythm_.repeat({600'000, 600'000});
  set_.clear();
  rhythm_.once({1, 1, 1, 1});
  rhythm_.repeat({3, 600'000});  // meanwhile the state has changed
  EXPECT_EQ(set_, Steps{true});
  wanted_ = 6;
  loop_.run();
  EXPECT_EQ(set_, (Steps{true, false, true, false, true, false}));
}

class PlayedLamp : public testing::Test {
 protected:
  ~PlayedLamp() override { std::filesystem::remove_all(leds_); }

  void put_led() {
    std::filesystem::create_directories(leds_ / "green");
    for (const auto& [name, text] :
         {std::pair("trigger", "[heartbeat] none\n"), std::pair("brightness", "7\n"),
          std::pair("max_brightness", "255\n")})
      write_text_file(leds_ / "green" / name, text);
  }
  std::string line(const char* name) const {
    const std::string text = read_text_file(leds_ / "green" / name);
    return text.substr(0, text.find('\n'));
  }

  const std::filesystem::path leds_ =
      std::filesystem::path(testing::TempDir()) /
      (std::string("leds") + testing::UnitTest::GetInstance()->current_test_info()->name());
};

TEST_F(PlayedLamp, ItsLedIsTakenFromItsTriggerAndGoesOutAtTheEnd) {
  put_led();
  {
    Lamp lamp({.led = "green", .gpio = {}, .beeper = {}}, leds_);
    lamp.set(true);
    EXPECT_EQ(line("trigger"), "none");
    EXPECT_EQ(line("brightness"), "255");
    lamp.set(false);
    EXPECT_EQ(line("brightness"), "0");
    lamp.set(true);
  }
  EXPECT_EQ(line("brightness"), "0");
}

TEST_F(PlayedLamp, ALedThatIsMissingIsToldOnce) {
  testing::internal::CaptureStderr();
  Lamp lamp({.led = "green", .gpio = {}, .beeper = {}}, leds_);
  for (int i = 0; i < 100; ++i) lamp.set(i % 2 == 0);
  const std::string said = testing::internal::GetCapturedStderr();
  EXPECT_NE(said.find("light: green: No such file or directory; it is tried again"),
            std::string::npos)
      << said;
  EXPECT_EQ(std::ranges::count(said, '\n'), 1);
}

TEST_F(PlayedLamp, ALineIsSetAndATakenOneToldOnce) {
  std::filesystem::create_directories(leds_);
  write_text_file(leds_ / "gpiochip0", "");
  GpioKernel kernel;
  kernel.folder = leds_;
  int refusals = 0;
  kernel.ioctl = [&](int, unsigned long, void*) {
    ++refusals;
    errno = EBUSY;
    return -1;
  };
  testing::internal::CaptureStderr();
  Lamp lamp({.led = {}, .gpio = GpioLineSettings{"gpiochip0", 4, false, Pull::as_is}, .beeper = {}},
            leds_, kernel);
  for (int i = 0; i < 10; ++i) lamp.set(true);
  EXPECT_EQ(refusals, 1) << "asked again after a while, not at each step";
  EXPECT_NE(testing::internal::GetCapturedStderr().find(
                "light: gpiochip0:4: another program or driver uses this line"),
            std::string::npos);
}

}  // namespace
}  // namespace throwcal
