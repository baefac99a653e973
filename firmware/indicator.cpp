// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/indicator.h"

#include <array>

namespace throwcal {
namespace {

constexpr int high_hz = 2000, low_hz = 500;

// Told apart by rhythm alone: how often, how long, how many at once. Mostly on: throws count.
const std::array<Signal, shown_states> signals{{
    {Shown::idle, {100, 1900}, {low_hz, {150}}, "a short flash every 2 s"},
    {Shown::warming_up, {800, 800}, {high_hz, {60}}, "slowly on and off"},
    {Shown::capturing, {1000}, {high_hz, {60, 90, 60}}, "on"},
    {Shown::throw_seen, {350, 150}, {high_hz, {250}}, "on, winking quickly"},
    {Shown::solving, {200, 200}, {}, "quickly on and off"},
    {Shown::done, {1600, 400}, {high_hz, {120, 120, 500}}, "on, one wink every 2 s"},
    {Shown::done_needs_more,
     {1000, 250, 250, 250},
     {high_hz, {500, 120, 120, 120, 120}},
     "on, two winks every 2 s"},
    {Shown::fault,
     {150, 150, 150, 150, 150, 1250},
     {low_hz, {400, 200, 400, 200, 400}},
     "three flashes, then dark"},
    {Shown::held, {50, 50}, {}, "flickering"},
    {Shown::refused,
     {100, 100, 100, 100, 100, 100, 700, 700},
     {low_hz, {700}},
     "three quick flashes and a long one, once"},
}};

std::string steps(const std::vector<int>& all_ms) {
  std::string out;
  for (const int ms : all_ms) out += (out.empty() ? "" : " ") + std::to_string(ms);
  return out;
}

Shown shown_of(const std::string& state, bool is_accepted) {
  if (state == "done" && !is_accepted) return Shown::done_needs_more;
  for (const Signal& signal : signals)
    if (to_string(signal.what) == state) return signal.what;
  return Shown::idle;
}

}  // namespace

std::string to_string(Shown what) {
  static constexpr std::array<const char*, shown_states> names{
      "idle", "warming-up",         "capturing", "throw-seen",  "solving",
      "done", "done, not accepted", "fault",     "button held", "refused"};
  return names.at(static_cast<std::size_t>(what));
}

Shown shown_of(const Status& status, bool is_held) {
  if (is_held) return Shown::held;
  if (status.fault) return Shown::fault;
  return shown_of(to_string(status.state), status.verdict == Verdict::accepted);
}

const Signal& signal_of(Shown what) { return signals.at(static_cast<std::size_t>(what)); }

Blinks blinks_of(Shown what, bool is_open) {
  Blinks out = signal_of(what).blinks;
  if (!is_open || what == Shown::held || what == Shown::refused) return out;
  if (out.size() % 2 == 1) out.push_back(300);
  out.insert(out.end(), {50, 100, 50, 100, 50, 300});
  return out;
}

std::string signal_table() {
  std::string out =
      "| shows | by its light | on, off, ... ms | beep, on, off, ... ms |\n|---|---|---|---|\n";
  for (const Signal& s : signals)
    out += "| " + to_string(s.what) + " | " + std::string(s.looks) + " | " + steps(s.blinks) +
           " | " +
           (s.beep.steps_ms.empty()
                ? "-"
                : std::to_string(s.beep.tone_hz) + " Hz: " + steps(s.beep.steps_ms)) +
           " |\n";
  return out;
}

}  // namespace throwcal
