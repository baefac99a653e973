// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/progress_bar.h"

#include <unistd.h>

#include <algorithm>
#include <cstdio>

namespace throwcal {

ProgressBar::ProgressBar(std::string task)
    : task_(std::move(task)), on_terminal_(isatty(STDERR_FILENO) == 1) {}

ProgressBar::~ProgressBar() {
  if (on_terminal_) std::fputs("\r\033[K", stderr);
}

bool ProgressBar::due() {
  using namespace std::chrono_literals;
  const auto now = std::chrono::steady_clock::now();
  if (!on_terminal_ || now - last_ < 50ms) return false;
  last_ = now;
  return true;
}

void ProgressBar::show(double fraction_done) {
  if (!due()) return;
  constexpr int width = 30;
  const double fraction = std::clamp(fraction_done, 0.0, 1.0);
  const auto full = static_cast<std::size_t>(width * fraction);
  std::fprintf(stderr, "\r\033[K%s [%s%s] %3.0f %%", task_.c_str(), std::string(full, '#').c_str(),
               std::string(width - full, '.').c_str(), 100.0 * fraction);
}

void ProgressBar::show_count(const std::string& done) {
  if (due()) std::fprintf(stderr, "\r\033[K%s: %s", task_.c_str(), done.c_str());
}

}  // namespace throwcal
