// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <functional>
#include <optional>

#include "firmware/contacts.h"
#include "firmware/evdev_button.h"
#include "firmware/gpio_button.h"
#include "firmware/light.h"

namespace throwcal {

/// What is on the box itself: its button, its light, its beeper. Whatever of these is missing is
/// waited for.
class Panel {
 public:
  /// `obey`: does what a press asks for; false where that is not possible now.
  Panel(EventLoop& loop, const ButtonSettings& button, const LightSettings& light,
        std::function<bool(Press)> obey);
  Panel(const Panel&) = delete;
  Panel& operator=(const Panel&) = delete;

  /// The configuration was read again. That is no start of the box: a button that is found down
  /// then resets nothing.
  void change(const ButtonSettings& button);
  void change(const LightSettings& light);

  /// `is_open`: anybody may change something (Access).
  void show(const Status& status, bool is_open);

 private:
  void read_edges();

  EventLoop& loop_;
  const std::function<bool(Press)> obey_;
  const Button::Time started_ = Button::Clock::now();
  std::optional<Light> light_;
  std::optional<Contacts> contacts_;
  std::optional<EvdevButton> keys_;
  std::optional<GpioButton> line_;
};

}  // namespace throwcal
