// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/watchdog.h"

#include <systemd/sd-daemon.h>

namespace throwcal {

std::optional<std::string> Movement::stuck(const std::vector<Seen>& all, Time now) {
  last_.resize(all.size());
  std::optional<std::string> out;
  for (std::size_t i = 0; i < all.size(); ++i) {
    Last& last = last_[i];
    if (all[i].may_rest || all[i].name != last.name || all[i].steps != last.steps)
      last = {all[i].name, all[i].steps, now};
    if (!out && now - last.moved > all[i].patience) out = all[i].name;
  }
  return out;
}

std::optional<std::chrono::microseconds> watchdog_period() {
  std::uint64_t us = 0;
  if (sd_watchdog_enabled(0, &us) <= 0) return {};
  return std::chrono::microseconds(us / 2);
}

}  // namespace throwcal
