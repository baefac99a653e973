// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>

#include "firmware/input_error.h"
#include "firmware/sightings_check.h"
#include "firmware/sightings_file.h"
#include "tests/fuzz/outside_text.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace throwcal;
  static const RigDescription rig = [] {
    RigDescription two;
    two.cameras.resize(2);
    two.cameras[0].name = "north";
    two.cameras[1].name = "east";
    for (CameraDescription& camera : two.cameras)
      camera.model.width_px = 640, camera.model.height_px = 480;
    return two;
  }();
  std::vector<SightingRow> rows;
  if (!is_accepted<InputError>(
          [&] { rows = parse_sightings(text_of(data, size), "sightings.csv", rig); }))
    return 0;
  is_accepted<InputError>([&] { check_usable(rows, rig, "sightings.csv"); });
  const std::string written = to_sightings_csv(rows, rig);
  require(to_sightings_csv(parse_sightings(written, "written.csv", rig), rig) == written,
          "what is written is read back");
  std::size_t count = 0;
  for (const Throw& thrown : labelled_throws(rows))
    for (const Track& track : thrown.tracks) count += track.sightings.size();
  for (const FrameSightings& frame : unlabelled_frames(rows)) count += frame.sightings.size();
  require(count == rows.size(), "every row is of a throw or of a frame");
  return 0;
}
