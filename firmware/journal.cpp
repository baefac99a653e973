// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/journal.h"

#include <sys/stat.h>
#include <sys/uio.h>
#include <syslog.h>
#define SD_JOURNAL_SUPPRESS_LOCATION  // the same line of this file for all
#include <systemd/sd-journal.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdio>
#include <cstdlib>
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

std::atomic<std::int64_t> session_now = 0;  ///< 0: none

/// Of Happening, in its order, and of causes; made once by `systemd-id128 new`, never changed.
constexpr std::array<const char*, 4> happenings{
    "77074e1f2855423186ee9de5268e522f", "99f88e4547354b13a45ad423b4e05076",
    "770f7a24545941a798b2bf110130a31e", "e60663473c8e4617ae7d7aa6d7b8762f"};

std::string message_id(std::string_view cause) {
  if (cause == "store") return "0d6a869fd48d461f94222aa39b4320b4";
  if (cause == "watchdog") return "7dda5702d3124d099730180a04019ba0";
  if (cause.starts_with("camera ")) return "d3fa380578e14141bed423e8dc748b63";
  return {};
}

/// One line whatever is in it: a client's bytes must not forge lines of the journal.
std::string one_line(std::string text) {
  std::ranges::replace_if(
      text, [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; }, ' ');
  return text;
}

/// As systemd tells in JOURNAL_STREAM, "device:inode"; whoever sends it elsewhere changes the file.
bool stderr_is_the_journal() {
  const char* told = std::getenv("JOURNAL_STREAM");
  struct stat facts {};
  return told && fstat(STDERR_FILENO, &facts) == 0 &&
         told == std::to_string(facts.st_dev) + ":" + std::to_string(facts.st_ino);
}

bool send_to_journal(const std::string& text, const LogFacts& facts) {
  static const bool is_there = stderr_is_the_journal();
  if (!is_there) return false;
  std::vector<std::string> fields = journal_fields(text, facts);
  std::vector<iovec> parts;
  for (std::string& field : fields) parts.push_back({field.data(), field.size()});
  return sd_journal_sendv(parts.data(), static_cast<int>(parts.size())) == 0;
}

std::string name_of(int priority) {
  return priority == LOG_INFO ? "info" : priority == LOG_WARNING ? "warning" : "error";
}

void write_line(const std::string& text, LogFacts facts) {
  if (const std::int64_t session = session_now) facts.session = session;
  const std::string line = one_line(text);
  recent().add(utc_now() + " " + name_of(facts.priority) + ": " + line);
  if (send_to_journal(line, facts)) return;
  static const bool to_a_person = isatty(STDERR_FILENO) == 1;
  const std::string mark = "<" + std::to_string(facts.priority) + ">";
  std::fprintf(stderr, "%s%s\n", to_a_person ? "throwcald: " : mark.c_str(), line.c_str());
}

/// Of `camera "north": its plug is loose`.
std::string camera_of(std::string_view text) {
  constexpr std::string_view begin = "camera \"";
  if (!text.starts_with(begin)) return {};
  const std::string_view name = text.substr(begin.size());
  return std::string(name.substr(0, name.find('"')));
}

}  // namespace

std::vector<std::string> journal_fields(std::string_view text, const LogFacts& facts) {
  std::vector<std::string> out{"MESSAGE=" + std::string(text),
                               "PRIORITY=" + std::to_string(facts.priority),
                               "SYSLOG_IDENTIFIER=throwcald"};
  const auto add = [&](const char* name, const std::string& value) {
    if (!value.empty()) out.push_back(std::string(name) + "=" + value);
  };
  if (facts.session) add("THROWCAL_SESSION", std::to_string(*facts.session));
  add("THROWCAL_CAMERA", camera_of(text));
  add("THROWCAL_CAUSE", facts.cause);
  add("MESSAGE_ID", facts.message_id);
  return out;
}

std::vector<std::string> recent_log_lines() { return recent().all(); }

void set_log_session(std::optional<std::int64_t> session) { session_now = session.value_or(0); }

void log_info(const std::string& text) { write_line(text, {.priority = LOG_INFO}); }
void log_warning(const std::string& text) { write_line(text, {.priority = LOG_WARNING}); }
void log_error(const std::string& text) { write_line(text, {.priority = LOG_ERR}); }

void log_info(Happening what, const std::string& text) {
  write_line(text,
             {.priority = LOG_INFO, .message_id = happenings.at(static_cast<std::size_t>(what))});
}

void LogOnce::warning(const std::string& cause, const std::string& text) {
  if (told_.insert(cause).second)
    write_line(text, {.priority = LOG_WARNING, .cause = cause, .message_id = message_id(cause)});
}

}  // namespace throwcal
