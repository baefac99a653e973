// SPDX-License-Identifier: BSD-3-Clause
#include <cstdio>

#include "firmware/box_client.h"
#include "firmware/cameras.h"
#include "firmware/commands.h"
#include "firmware/input_error.h"

namespace {

int tell(const std::exception& error, int status) {
  std::fprintf(stderr, "throwcal: %s\n", error.what());
  return status;
}

}  // namespace

int main(int argc, char** argv) {
  using namespace throwcal;
  silence_video_libraries();
  CLI::App app("throwcal calibrates a rig of cameras from thrown balls.", "throwcal");
  app.set_version_flag("--version", "throwcal " THROWCAL_VERSION);
  app.require_subcommand(1);
  app.footer(
      "Try it without a camera:\n"
      "  throwcal simulate --output try\n"
      "  throwcal calibrate --rig try/rig.toml --sightings try/sightings.csv --output "
      "try/calibration.json\n"
      "Each command explains itself: throwcal calibrate --help");
  int status = exit_accepted;
  add_calibrate_command(app, status);
  add_cameras_command(app, status);
  add_detect_command(app, status);
  add_picture_command(app, status);
  add_record_commands(app, status);
  add_simulate_command(app, status);
  add_box_commands(app, status);
  try {
    app.parse(argc, argv);
    return status;
  } catch (const CLI::Success& asked_for_help) {
    return app.exit(asked_for_help);
  } catch (const CLI::ParseError& error) {
    std::fprintf(stderr, "throwcal: %s (throwcal --help tells more)\n", error.what());
    return exit_unusable_input;
  } catch (const BoxError& error) {
    return tell(error, exit_failed);
  } catch (const InputError& error) {
    return tell(error, exit_unusable_input);
  } catch (const std::exception& error) {
    return tell(error, exit_unusable_input);
  }
}
