// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/journal.h"

#include <systemd/sd-daemon.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>

namespace throwcal {
namespace {

/// One line whatever is in it: a client's bytes must not forge lines of the journal.
void write_line(const char* priority, std::string text) {
  std::ranges::replace_if(
      text, [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; }, ' ');
  static const bool to_a_person = isatty(STDERR_FILENO) == 1;
  std::fprintf(stderr, "%s%s\n", to_a_person ? "throwcald: " : priority, text.c_str());
}

}  // namespace

void log_info(const std::string& text) { write_line(SD_INFO, text); }
void log_warning(const std::string& text) { write_line(SD_WARNING, text); }
void log_error(const std::string& text) { write_line(SD_ERR, text); }

void LogOnce::warning(const std::string& cause, const std::string& text) {
  if (told_.insert(cause).second) log_warning(text);
}

}  // namespace throwcal
