// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <chrono>
#include <optional>

namespace throwcal {

/// What somebody means with the button.
enum class Press {
  short_press,    ///< released within 3 s: capture, or stop
  abort,          ///< held for 3 s; told while it still is
  factory_reset,  ///< held for 10 s, and down already when the box started; likewise
};

struct ButtonTimes {
  std::chrono::milliseconds debounce{30};  ///< a contact counts once it has kept still so long
  std::chrono::milliseconds abort{3'000};
  std::chrono::milliseconds reset{10'000};
  std::chrono::milliseconds boot{5'000};  ///< since the start: who is found down then was so before
};

/// One contact's edges in, presses out; no clock inside. Times are those of the edges, on
/// CLOCK_MONOTONIC; one that goes back counts as the newest that was told. Repeated edges the same
/// way are none, so a key's autorepeat is nothing. Each call returns at most one press: between two
/// calls the contact keeps still.
class Button {
 public:
  using Clock = std::chrono::steady_clock;
  using Time = Clock::time_point;

  /// `started`: when the box did.
  explicit Button(Time started, const ButtonTimes& times = {});

  /// It is down at the first look. Soon after the start that may become a factory reset; later it
  /// means nothing until it is released: the device has come back with a finger, or a stuck key.
  void found_down(Time at);
  std::optional<Press> edge(bool down, Time at);
  /// Time goes on.
  std::optional<Press> advance(Time now);
  /// When advance() has something to do next; nothing while it waits for an edge.
  std::optional<Time> next() const;
  /// Somebody is at it: down, not just a bounce, and it may still mean something.
  bool is_held() const;

 private:
  /// What the press under way can still become.
  enum class Meaning { none, press, reset };

  std::optional<Press> settle(Time now);
  Time due() const;  ///< of what a press under way becomes by being held

  Time started_;
  ButtonTimes times_;
  bool contact_ = false, is_down_ = false;  ///< as the last edge left it; once it kept still
  Time changed_, pressed_{}, newest_;
  Meaning meaning_ = Meaning::none;
};

}  // namespace throwcal
