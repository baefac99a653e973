// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/panel.h"

namespace throwcal {

Panel::Panel(EventLoop& loop, const ButtonSettings& button, const LightSettings& light,
             std::function<bool(Press)> obey)
    : contacts_(
          loop, button.times, [this] { read_edges(); },
          [this, obey = std::move(obey)](Press press) {
            if (!obey(press) && light_) light_->refuse();
          }) {
  if (light.is_there()) light_.emplace(loop, light);
  if (!button.evdev.keys.empty()) keys_.emplace(loop, contacts_, button.evdev);
  if (button.gpio) line_.emplace(loop, contacts_, *button.gpio, button.times.debounce);
}

void Panel::show(const Status& status, bool is_open) {
  if (light_) light_->show(shown_of(status, contacts_.is_held()), is_open);
}

void Panel::read_edges() {
  if (keys_) keys_->read_edges();
  if (line_) line_->read_edges();
}

}  // namespace throwcal
