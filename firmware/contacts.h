// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <functional>
#include <map>
#include <string>

#include "firmware/button.h"
#include "firmware/event_loop.h"

namespace throwcal {

/// Every contact that is the box's button, each debounced and timed for itself: one that is stuck
/// keeps no other from being pressed. Timers by the main loop.
class Contacts {
 public:
  /// `started`: when the box did. `read_edges`: tells those that wait already. A loop that was late
  /// must not take a short press for a long one.
  Contacts(EventLoop& loop, const ButtonTimes& times, Button::Time started,
           std::function<void()> read_edges, std::function<void(Press)> pressed);

  /// A contact is there from now on. `is_debounced`: by whoever tells its edges.
  void add(const std::string& name, bool is_down, bool is_debounced = false);
  void edge(const std::string& name, bool is_down, Button::Time at);
  /// It is gone, and what was pressed on it means nothing.
  void remove(const std::string& name);
  bool is_held() const;

 private:
  void tell(std::optional<Press> press);
  void advance_all();
  void set_timer();

  ButtonTimes times_;
  const Button::Time started_;
  std::function<void()> read_edges_;
  std::function<void(Press)> pressed_;
  std::map<std::string, Button> buttons_;
  EventLoop::Source timer_;
};

}  // namespace throwcal
