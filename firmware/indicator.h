// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "firmware/status.h"

namespace throwcal {

/// What the box shows to whoever stands before it.
enum class Shown {
  idle,
  warming_up,
  capturing,
  throw_seen,
  solving,
  done,             ///< and the calibration is accepted
  done_needs_more,  ///< and it is not
  fault,
  held,     ///< somebody holds the button
  refused,  ///< what the button asked for is not possible now; once
};
constexpr std::size_t shown_states = 10;
std::string to_string(Shown what);  ///< "idle", "warming-up", ...

/// Time on, time off, time on, ... in milliseconds, again and again. One number: on all the time.
using Blinks = std::vector<int>;

/// A beep's times on and off, once; empty: silence.
struct Beep {
  int tone_hz = 0;
  std::vector<int> steps_ms;
};

struct Signal {
  Shown what;
  Blinks blinks;
  Beep beep;               ///< as it begins
  std::string_view looks;  ///< in words
};

/// What a box in this state shows; `is_held`: the button is.
Shown shown_of(const Status& status, bool is_held);
const Signal& signal_of(Shown what);
/// The same, and that anybody may change something for a while after a press of the button: three
/// quick flashes in between.
Blinks blinks_of(Shown what, bool is_open);

/// The table of all, in Markdown. (firmware/README.md)
std::string signal_table();

}  // namespace throwcal
