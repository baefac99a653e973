// SPDX-License-Identifier: BSD-3-Clause
#include <systemd/sd-daemon.h>

#include "firmware/daemon.h"

namespace throwcal {

/// Systemd is told that all is well only while cameras and estimator move: from the tick, so the
/// main loop does. It starts the box anew otherwise.
void Daemon::pet_watchdog(const std::vector<CameraStats>& cameras) {
  if (!watchdog_period_) return;
  std::vector<Movement::Seen> all{{.name = "the estimator",
                                   .may_rest = estimator_->is_waiting(),
                                   .steps = estimator_->turns(),
                                   .patience = Movement::estimator_patience}};
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    // A film waits while the estimator is busy.
    const bool may_rest = !cameras[i].running || config_.inputs[i].source.starts_with("video:");
    all.push_back({.name = "camera \"" + cameras[i].name + "\"",
                   .may_rest = may_rest,
                   .steps = cameras[i].frames});
  }
  const auto now = std::chrono::steady_clock::now();
  if (const auto stuck = movement_.stuck(all, now))
    return once_.warning("watchdog",
                         *stuck + " hangs and says nothing; so the watchdog is not petted");
  once_.forget("watchdog");
  if (now - petted_ < *watchdog_period_) return;
  sd_notify(0, "WATCHDOG=1");
  petted_ = now;
}

}  // namespace throwcal
