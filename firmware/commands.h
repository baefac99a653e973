// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <CLI/CLI.hpp>
#include <memory>

namespace throwcal {

struct BoxOptions;

/// What `throwcal` says to the shell.
enum ExitStatus : int {
  exit_accepted = 0,
  exit_failed = 1,  ///< the box is not there or refuses
  exit_unusable_input = 2,
  exit_not_accepted = 3,  ///< a result was written; its verdict is not `accepted`
};

/// Each adds subcommands whose callback does the work and sets `status`. A callback throws
/// InputError (exit 2) or BoxError (exit 1), told by main() in one line.
void add_calibrate_command(CLI::App& app, int& status);
void add_cameras_command(CLI::App& app, int& status);
void add_detect_command(CLI::App& app, int& status);
void add_picture_command(CLI::App& app, int& status);
void add_record_commands(CLI::App& app, int& status);
void add_simulate_command(CLI::App& app, int& status);
void add_box_commands(CLI::App& app, int& status);  ///< those of sessions, too
void add_session_commands(CLI::App& app, int& status, const std::shared_ptr<BoxOptions>& box);

}  // namespace throwcal
