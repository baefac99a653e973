// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/contacts.h"

#include <algorithm>

namespace throwcal {

using namespace std::chrono_literals;

Contacts::Contacts(EventLoop& loop, const ButtonTimes& times, Button::Time started,
                   std::function<void()> read_edges, std::function<void(Press)> pressed)
    : times_(times),
      started_(started),
      read_edges_(std::move(read_edges)),
      pressed_(std::move(pressed)),
      timer_(loop.on_timer(0ms, [this] { advance_all(); })) {}

void Contacts::add(const std::string& name, bool is_down, bool is_debounced) {
  ButtonTimes times = times_;
  if (is_debounced) times.debounce = 0ms;
  Button button(started_, times);
  if (is_down) button.found_down(Button::Clock::now());
  buttons_.insert_or_assign(name, button);
  set_timer();
}

void Contacts::edge(const std::string& name, bool is_down, Button::Time at) {
  const auto button = buttons_.find(name);
  if (button == buttons_.end()) return;
  const auto press = button->second.edge(is_down, at);
  set_timer();
  tell(press);
}

void Contacts::remove(const std::string& name) { buttons_.erase(name); }

bool Contacts::is_held() const {
  return std::ranges::any_of(buttons_, [](const auto& named) { return named.second.is_held(); });
}

void Contacts::tell(std::optional<Press> press) {
  if (press) pressed_(*press);
}

void Contacts::advance_all() {
  const Button::Time now = Button::Clock::now();
  read_edges_();
  for (auto& [name, button] : buttons_) tell(button.advance(now));
  set_timer();
}

void Contacts::set_timer() {
  std::optional<Button::Time> next;
  for (const auto& [name, button] : buttons_)
    if (const auto due = button.next()) next = std::min(*due, next.value_or(*due));
  if (!next) return;  // at worst it rings once for nothing
  const auto wait = std::chrono::ceil<std::chrono::microseconds>(*next - Button::Clock::now());
  timer_.after(std::max<std::chrono::microseconds>(wait, 0us));
}

}  // namespace throwcal
