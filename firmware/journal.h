// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

namespace throwcal {

/// Lines on standard error, with the priority marks that systemd's journal reads ("<6>..."); on a
/// terminal with the program's name in their place. Where standard error is the journal, entries
/// with fields instead (journal_fields()).
void log_info(const std::string& text);
void log_warning(const std::string& text);
void log_error(const std::string& text);

/// The last lines of this process, oldest first: at most 500, of at most 500 bytes each, with time
/// and priority ("2026-01-31T12:00:00Z warning: ..."). Thread-safe, as are those that log.
std::vector<std::string> recent_log_lines();

/// What happened, where a program may want to find it: the journal's MESSAGE_ID.
enum class Happening { session_began, session_ended, session_aborted, new_token };
void log_info(Happening what, const std::string& text);

/// Which session lines are of from now on.
void set_log_session(std::optional<std::int64_t> session);

/// Tells each cause once, however often it happens; forget() lets it be told again.
class LogOnce {
 public:
  void warning(const std::string& cause, const std::string& text);
  void forget(const std::string& cause) { told_.erase(cause); }

 private:
  std::set<std::string> told_;
};

/// What is known of a line beside its text.
struct LogFacts {
  int priority = 6;
  std::optional<std::int64_t> session{};
  std::string cause{}, message_id{};
};

/// A line as the journal's entry: MESSAGE=, PRIORITY=, THROWCAL_SESSION=, THROWCAL_CAMERA= of the
/// camera that the text begins with, THROWCAL_CAUSE=, MESSAGE_ID=. What is not known has none.
std::vector<std::string> journal_fields(std::string_view text, const LogFacts& facts);

}  // namespace throwcal
