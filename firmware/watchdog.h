// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace throwcal {

/// Whether the box still moves: its main loop (who else would ask?), each camera, its estimator. No
/// clock inside.
class Movement {
 public:
  using Time = std::chrono::steady_clock::time_point;
  /// A camera says itself after 2 s that no frames come; one that says nothing for so long hangs.
  static constexpr std::chrono::seconds camera_patience{5};
  /// Putting the flights of a long session together is a turn, too.
  static constexpr std::chrono::seconds estimator_patience{30};

  /// What can be seen of one that ought to move.
  struct Seen {
    std::string name;
    bool may_rest = false;    ///< it has ended, has said an error, or waits for work
    std::uint64_t steps = 0;  ///< frames, turns
    std::chrono::seconds patience = camera_patience;
  };

  /// Who has neither moved nor may rest for longer than its patience; nothing: all is well.
  std::optional<std::string> stuck(const std::vector<Seen>& all, Time now);

 private:
  struct Last {
    std::string name;
    std::uint64_t steps = 0;
    Time moved{};
  };
  std::vector<Last> last_;
};

/// How often systemd's watchdog wants to be petted (WATCHDOG_USEC), in half of the time it gives;
/// nothing where it does not watch this process.
std::optional<std::chrono::microseconds> watchdog_period();

}  // namespace throwcal
