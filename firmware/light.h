// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "firmware/event_loop.h"
#include "firmware/file_handle.h"
#include "firmware/gpio_lines.h"
#include "firmware/indicator.h"
#include "firmware/journal.h"

namespace throwcal {

/// Steps through on and off, by the main loop's timers.
class Rhythm {
 public:
  Rhythm(EventLoop& loop, std::function<void(bool on)> set);

  void repeat(const Blinks& steps);  ///< from its beginning, where it is another
  /// Now, and then what was repeated; from its beginning.
  void once(const Blinks& steps);

 private:
  void begin(const Blinks& steps);
  void step();

  std::function<void(bool on)> set_;
  Blinks repeated_, steps_;
  std::size_t at_ = 0;
  bool is_once_ = false;
  EventLoop::Source timer_;
};

/// A LED of /sys/class/leds, a GPIO line, or both. What is not there, or goes away, is told once
/// and tried again. Off at the end.
class Lamp {
 public:
  explicit Lamp(const LightSettings& settings, std::filesystem::path leds = "/sys/class/leds",
                const GpioKernel& kernel = {});
  ~Lamp();

  void set(bool is_on);

 private:
  bool open_led(std::string& why);
  void set_led(bool is_on);
  void set_line(bool is_on);

  LightSettings settings_;
  std::filesystem::path leds_;
  GpioKernel kernel_;
  LogOnce once_;
  FileHandle brightness_;
  std::string brightest_;
  std::optional<GpioLine> line_;
  std::chrono::steady_clock::time_point try_led_at_{}, try_line_at_{};
};

/// An input device that sounds (pcspkr, a USB buzzer): EV_SND, SND_TONE. Likewise.
class Beeper {
 public:
  explicit Beeper(std::filesystem::path device) : device_(std::move(device)) {}
  ~Beeper() { set(0); }

  void set(int tone_hz);  ///< 0: silence

 private:
  std::filesystem::path device_;
  LogOnce once_;
  FileHandle file_;
  bool sounds_ = false;
};

/// Shows and sounds what the indicator says.
class Light {
 public:
  Light(EventLoop& loop, const LightSettings& settings);

  void show(Shown what, bool is_open);
  void refuse();  ///< blinks that once

 private:
  void beep(const Beep& beep);

  Lamp lamp_;
  Beeper beeper_;
  int tone_hz_ = 0;
  std::optional<Shown> told_;  ///< by a beep: the last state, without the button's
  Rhythm blinking_, beeping_;
};

}  // namespace throwcal
