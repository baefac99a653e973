// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/panel.h"

namespace throwcal {

Panel::Panel(EventLoop& loop, const ButtonSettings& button, const LightSettings& light,
             std::function<bool(Press)> obey)
    : loop_(loop), obey_(std::move(obey)) {
  change(light);
  change(button);
}

void Panel::change(const LightSettings& light) {
  light_.reset();  // lets go of its devices
  if (light.is_there()) light_.emplace(loop_, light);
}

void Panel::change(const ButtonSettings& button) {
  line_.reset();
  keys_.reset();
  contacts_.emplace(
      loop_, button.times, started_, [this] { read_edges(); },
      [this](Press press) {
        if (!obey_(press) && light_) light_->refuse();
      });
  if (!button.evdev.keys.empty()) keys_.emplace(loop_, *contacts_, button.evdev);
  if (button.gpio) line_.emplace(loop_, *contacts_, *button.gpio, button.times.debounce);
}

void Panel::show(const Status& status, bool is_open) {
  if (light_) light_->show(shown_of(status, contacts_->is_held()), is_open);
}

void Panel::read_edges() {
  if (keys_) keys_->read_edges();
  if (line_) line_->read_edges();
}

}  // namespace throwcal
