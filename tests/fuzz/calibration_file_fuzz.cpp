// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/calibration_table.h"
#include "firmware/export.h"
#include "firmware/input_error.h"
#include "firmware/picture.h"
#include "tests/fuzz/outside_text.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace throwcal;
  static const RigDescription rig = [] {
    RigDescription two;
    two.cameras.resize(2);
    two.cameras[0].name = "north";
    two.cameras[1].name = "east";
    return two;
  }();
  Json document;
  Calibration read;
  if (!is_accepted<InputError>([&] {
        document = parse_json(text_of(data, size), "c.json");
        read = to_calibration(document, "c.json");
      }))
    return 0;
  is_accepted<InputError>([&] { to_guess(document, rig, "c.json"); });
  const std::string written = to_json(read, "").dump();
  const Calibration back = to_calibration(parse_json(written, "written.json"), "written.json");
  require(back.cameras.size() == read.cameras.size() && back.throws.size() == read.throws.size(),
          "what is written is read back");
  require(!calibration_table(read).empty() && !to_svg(read).empty(), "it can be shown");
  return 0;
}
