// SPDX-License-Identifier: BSD-3-Clause
#include <systemd/sd-daemon.h>

#include <algorithm>
#include <ctime>

#include "firmware/config_changes.h"
#include "firmware/daemon.h"
#include "firmware/input_error.h"

namespace throwcal {
namespace {

std::string list(const std::vector<std::string>& names) {
  std::string out;
  for (const std::string& name : names) out += (out.empty() ? "" : ", ") + name;
  return out;
}

bool has(const std::vector<std::string>& changes, std::string_view table) {
  return std::ranges::any_of(changes,
                             [&](const auto& change) { return change.starts_with(table); });
}

/// systemd asks for the moment at which the reload began.
long long monotonic_us() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return now.tv_sec * 1'000'000LL + now.tv_nsec / 1'000;
}

}  // namespace

/// SIGHUP. A file that is broken changes nothing.
void Daemon::reload() {
  sd_notifyf(0, "RELOADING=1\nMONOTONIC_USEC=%lld", monotonic_us());
  try {
    Config next = read_config(settings_.config_file);
    for (const std::string& warning : next.warnings) log_warning(warning);
    take_over(std::move(next));
  } catch (const InputError& error) {
    log_error("the configuration stays as it was: " + std::string(error.what()));
  }
  sd_notify(0, "READY=1");
}

/// What needs a restart is named and left; so is then what a session's own rig file would no longer
/// say truly. A session under way ends as it began.
void Daemon::take_over(Config next) {
  std::vector<std::string> now, later, restart;
  for (const std::string& change : config_changes(config_.text, next.text))
    (taken(change) == Taken::at_once            ? now
     : taken(change) == Taken::between_sessions ? later
                                                : restart)
        .push_back(change);
  next_config_.reset();
  config_.unit = next.unit;
  config_.button = next.button;
  config_.light = next.light;
  if (has(now, "[button]")) panel_->change(config_.button);
  if (has(now, "[light]")) panel_->change(config_.light);
  if (!now.empty()) log_info("configuration changed: " + list(now));
  if (!restart.empty()) {
    restart.insert(restart.end(), later.begin(), later.end());
    log_warning("this change of the configuration needs a restart: " + list(restart));
  } else if (!later.empty() || !now.empty()) {
    if (!later.empty()) log_info("configuration changes for the next session: " + list(later));
    next_config_ = std::move(next);
  }
  take_next_config();
}

void Daemon::take_next_config() {
  if (!next_config_ || session_.is_watching() || session_.state() == SessionState::solving) return;
  config_.text = next_config_->text;
  config_.rig.target = next_config_->rig.target;
  config_.target_throws = next_config_->target_throws;
  config_.pre_trigger = next_config_->pre_trigger;
  estimator_->change(config_.rig.target, config_.pre_trigger);
  next_config_.reset();
}

}  // namespace throwcal
