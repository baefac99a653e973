// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/button.h"

#include <algorithm>

namespace throwcal {

Button::Button(Time started, const ButtonTimes& times)
    : started_(started), times_(times), changed_(started), newest_(started) {}

void Button::found_down(Time at) {
  newest_ = std::max(at, newest_);
  contact_ = is_down_ = true;
  changed_ = pressed_ = newest_;
  meaning_ = newest_ - started_ <= times_.boot ? Meaning::reset : Meaning::none;
}

std::optional<Press> Button::edge(bool down, Time at) {
  const auto press = advance(at);
  if (down != contact_) {
    contact_ = down;
    changed_ = newest_;
  }
  if (times_.debounce.count() > 0) return press;
  const auto settled = settle(newest_);  // at once: a remote control sends both edges together
  return press ? press : settled;
}

std::optional<Press> Button::advance(Time now) {
  newest_ = std::max(now, newest_);
  const auto settled = settle(newest_);
  if (settled || !is_down_ || !contact_ || meaning_ == Meaning::none || newest_ < due())
    return settled;
  const Press held = meaning_ == Meaning::reset ? Press::factory_reset : Press::abort;
  meaning_ = Meaning::none;
  return held;
}

/// A contact that has kept still becomes the button's state, as of its edge.
std::optional<Press> Button::settle(Time now) {
  if (contact_ == is_down_ || now - changed_ < times_.debounce) return {};
  is_down_ = contact_;
  if (is_down_) {
    pressed_ = changed_;
    meaning_ = Meaning::press;
    return {};
  }
  const bool is_short = meaning_ == Meaning::press;
  meaning_ = Meaning::none;
  if (!is_short) return {};
  return changed_ - pressed_ < times_.abort ? Press::short_press : Press::abort;
}

Button::Time Button::due() const {
  return pressed_ + (meaning_ == Meaning::reset ? times_.reset : times_.abort);
}

std::optional<Button::Time> Button::next() const {
  if (contact_ != is_down_) return changed_ + times_.debounce;
  if (is_down_ && meaning_ != Meaning::none) return due();
  return {};
}

bool Button::is_held() const { return is_down_ && meaning_ != Meaning::none; }

}  // namespace throwcal
