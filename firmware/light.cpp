// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/light.h"

#include <fcntl.h>
#include <linux/input.h>

#include <cerrno>
#include <charconv>
#include <cstring>

#include "firmware/input_error.h"
#include "firmware/text_file.h"

namespace throwcal {
namespace {

using namespace std::chrono_literals;

constexpr auto try_period = 1s;

std::string cause() { return std::strerror(errno); }

bool write_all(int fd, std::string_view text) {
  return ::pwrite(fd, text.data(), text.size(), 0) == static_cast<ssize_t>(text.size());
}

}  // namespace

Rhythm::Rhythm(EventLoop& loop, std::function<void(bool on)> set)
    : set_(std::move(set)), timer_(loop.on_timer(0ms, [this] { step(); })) {}

void Rhythm::repeat(const Blinks& steps) {
  if (steps == repeated_) return;
  repeated_ = steps;
  if (!is_once_) begin(repeated_);
}

void Rhythm::once(const Blinks& steps) {
  is_once_ = true;
  begin(steps);
}

void Rhythm::begin(const Blinks& steps) {
  steps_ = steps;
  at_ = 0;
  step();
}

void Rhythm::step() {
  if (at_ == steps_.size()) {
    at_ = 0;
    if (is_once_) {
      is_once_ = false;
      steps_ = repeated_;
    }
  }
  if (steps_.empty()) return set_(false);
  set_(at_ % 2 == 0);
  timer_.after(std::chrono::milliseconds(steps_[at_++]));
}

Lamp::Lamp(const LightSettings& settings, std::filesystem::path leds, const GpioKernel& kernel)
    : settings_(settings), leds_(std::move(leds)), kernel_(kernel) {}

Lamp::~Lamp() { set(false); }

void Lamp::set(bool is_on) {
  const auto now = std::chrono::steady_clock::now();
  if (!settings_.led.empty() && now >= try_led_at_) {
    set_led(is_on);
    if (!brightness_.is_open()) try_led_at_ = now + try_period;
  }
  if (settings_.gpio && now >= try_line_at_) {
    set_line(is_on);
    if (!line_) try_line_at_ = now + try_period;
  }
}

/// Takes it from whatever lets it blink now.
bool Lamp::open_led(std::string& why) {
  const auto folder = leds_ / settings_.led;
  const FileHandle trigger(::open((folder / "trigger").c_str(), O_WRONLY | O_CLOEXEC));
  if (trigger.is_open() && !write_all(trigger.get(), "none\n")) why = "trigger: " + cause();
  brightness_ = FileHandle(::open((folder / "brightness").c_str(), O_WRONLY | O_CLOEXEC));
  if (!brightness_.is_open()) {
    why = cause();
    return false;
  }
  try {
    const std::string text = read_text_file(folder / "max_brightness");
    brightest_ = text.substr(0, text.find('\n')) + "\n";
  } catch (const InputError&) {
    brightest_ = "1\n";
  }
  return true;
}

void Lamp::set_led(bool is_on) {
  std::string why;
  if (!brightness_.is_open() && !open_led(why)) {
    once_.warning("led", "light: " + settings_.led + ": " + why + "; it is tried again");
    return;
  }
  if (write_all(brightness_.get(), is_on ? brightest_ : "0\n")) return once_.forget("led");
  once_.warning("led", "light: " + settings_.led + ": " + cause() + "; it is tried again");
  brightness_ = {};
}

void Lamp::set_line(bool is_on) {
  std::string why = to_string(*settings_.gpio) + ": " + std::strerror(ENODEV);
  if (!line_) line_ = GpioLine::output(*settings_.gpio, why, kernel_);
  if (line_ && line_->set(is_on)) return once_.forget("line");
  line_.reset();
  once_.warning("line", "light: " + why + "; it is tried again");
}

void Beeper::set(int tone_hz) {
  if (device_.empty() || (tone_hz == 0 && !sounds_)) return;
  if (!file_.is_open())
    file_ = FileHandle(::open(device_.c_str(), O_WRONLY | O_NONBLOCK | O_CLOEXEC));
  input_event event{};
  event.type = EV_SND;
  event.code = SND_TONE;
  event.value = tone_hz;
  input_event end{};
  end.type = EV_SYN;
  const input_event both[] = {event, end};
  sounds_ = file_.is_open() && ::write(file_.get(), both, sizeof both) == sizeof both;
  if (sounds_) {
    sounds_ = tone_hz != 0;
    return once_.forget("beep");
  }
  once_.warning("beep", "light: " + device_.string() + ": " + cause() + "; it is tried again");
  file_ = {};
}

Light::Light(EventLoop& loop, const LightSettings& settings)
    : lamp_(settings),
      beeper_(settings.beeper),
      blinking_(loop, [this](bool on) { lamp_.set(on); }),
      beeping_(loop, [this](bool on) { beeper_.set(on ? tone_hz_ : 0); }) {}

void Light::show(Shown what, bool is_open) {
  blinking_.repeat(blinks_of(what, is_open));
  if (what == Shown::held || told_ == what) return;
  beep(signal_of(what).beep);
  told_ = what;
}

void Light::refuse() {
  blinking_.once(signal_of(Shown::refused).blinks);
  beep(signal_of(Shown::refused).beep);
}

void Light::beep(const Beep& beep) {
  if (beep.steps_ms.empty()) return;
  tone_hz_ = beep.tone_hz;
  beeping_.once(beep.steps_ms);
}

}  // namespace throwcal
