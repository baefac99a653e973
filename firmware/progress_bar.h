// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <chrono>
#include <string>

namespace throwcal {

/// A line on a terminal's standard error that shows how far long work is; nothing at all where
/// standard error is no terminal. Cleared when it goes out of scope.
class ProgressBar {
 public:
  explicit ProgressBar(std::string task);
  ~ProgressBar();
  ProgressBar(const ProgressBar&) = delete;
  ProgressBar& operator=(const ProgressBar&) = delete;

  void show(double fraction_done);           ///< 0 to 1
  void show_count(const std::string& done);  ///< where the end isn't known: "1234 frames"

 private:
  bool due();

  std::string task_;
  bool on_terminal_;
  std::chrono::steady_clock::time_point last_{};
};

}  // namespace throwcal
