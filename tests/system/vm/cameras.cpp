// SPDX-License-Identifier: BSD-3-Clause
// `throwcal cameras` alone: built in seconds where all of throwcal takes minutes.
#include "firmware/commands.h"

int main(int argc, char** argv) {
  CLI::App app;
  int status = throwcal::exit_accepted;
  throwcal::add_cameras_command(app, status);
  CLI11_PARSE(app, argc, argv);
  return status;
}
