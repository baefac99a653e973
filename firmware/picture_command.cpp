// SPDX-License-Identifier: BSD-3-Clause
#include <cstdio>

#include "firmware/commands.h"
#include "firmware/export.h"
#include "firmware/picture.h"
#include "firmware/text_file.h"

namespace throwcal {

void add_picture_command(CLI::App& app, int& status) {
  auto* command = app.add_subcommand("picture", "Draw a calibrated rig and its flights (SVG)");
  auto calibration = std::make_shared<std::string>();
  auto output = std::make_shared<std::string>();
  command->add_option("calibration", *calibration, "A calibration file (JSON)")->required();
  command->add_option("--output", *output, "Where the drawing goes; absent: standard output");
  command->footer("Example:\n  throwcal picture calibration.json --output rig.svg");
  command->callback([calibration, output, &status] {
    const std::string svg = to_svg(to_calibration(read_json(*calibration), *calibration));
    if (output->empty())
      std::fputs(svg.c_str(), stdout);
    else
      write_text_file(*output, svg);
    status = exit_accepted;
  });
}

}  // namespace throwcal
