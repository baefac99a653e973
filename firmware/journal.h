// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <set>
#include <string>
#include <vector>

namespace throwcal {

/// Lines on standard error, with the priority marks that systemd's journal reads ("<6>..."); on a
/// terminal with the program's name in their place.
void log_info(const std::string& text);
void log_warning(const std::string& text);
void log_error(const std::string& text);
/// The last lines of this process, oldest first: at most 500, of at most 500 bytes each, with time
/// and priority ("2026-01-31T12:00:00Z warning: ..."). Thread-safe, as are those that log.
std::vector<std::string> recent_log_lines();

/// Tells each cause once, however often it happens; forget() lets it be told again.
class LogOnce {
 public:
  void warning(const std::string& cause, const std::string& text);
  void forget(const std::string& cause) { told_.erase(cause); }

 private:
  std::set<std::string> told_;
};

}  // namespace throwcal
