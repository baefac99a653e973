// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/journal.h"

#include <systemd/sd-daemon.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <deque>
#include <mutex>

#include "firmware/export.h"

namespace throwcal {
namespace {

constexpr std::size_t lines_kept = 500, bytes_kept = 500;

/// What a support bundle shows of the log, wherever standard error leads to.
class RecentLines {
 public:
  void add(const std::string& line) {
    const std::lock_guard lock(mutex_);
    if (lines_.size() == lines_kept) lines_.pop_front();
    lines_.push_back(line.substr(0, bytes_kept));
  }
  std::vector<std::string> all() const {
    const std::lock_guard lock(mutex_);
    return {lines_.begin(), lines_.end()};
  }

 private:
  mutable std::mutex mutex_;
  std::deque<std::string> lines_;
};

RecentLines& recent() {
  static RecentLines lines;
  return lines;
}

/// One line whatever is in it: a client's bytes must not forge lines of the journal.
void write_line(const char* priority, const char* name, std::string text) {
  std::ranges::replace_if(
      text, [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; }, ' ');
  static const bool to_a_person = isatty(STDERR_FILENO) == 1;
  std::fprintf(stderr, "%s%s\n", to_a_person ? "throwcald: " : priority, text.c_str());
  recent().add(utc_now() + " " + name + ": " + text);
}

}  // namespace

void log_info(const std::string& text) { write_line(SD_INFO, "info", text); }
void log_warning(const std::string& text) { write_line(SD_WARNING, "warning", text); }
void log_error(const std::string& text) { write_line(SD_ERR, "error", text); }

std::vector<std::string> recent_log_lines() { return recent().all(); }

void LogOnce::warning(const std::string& cause, const std::string& text) {
  if (told_.insert(cause).second) log_warning(text);
}

}  // namespace throwcal
