// SPDX-License-Identifier: BSD-3-Clause
// The whole way: a rig file, sightings and perhaps a guess, with a line "---" between them.
// Whatever the parsers accept, calibrate() must come to an end with a verdict.
#include "estimator/calibrate.h"

#include "firmware/config.h"
#include "firmware/export.h"
#include "firmware/sightings_check.h"
#include "firmware/sightings_file.h"
#include "firmware/throw_search.h"
#include "tests/fuzz/outside_text.h"

namespace throwcal {
namespace {

constexpr std::size_t most_cameras = 4, most_rows = 400;  // so that an input takes a moment only

/// The text up to the next "---" line, which is taken off with it.
std::string_view take_part(std::string_view& text) {
  constexpr std::string_view border = "\n---\n";
  const std::size_t end = std::min(text.find(border), text.size());
  const std::string_view part = text.substr(0, end);
  text.remove_prefix(std::min(end + border.size(), text.size()));
  return part;
}

void check(const Calibration& result, const RigDescription& rig) {
  require(result.cameras.size() == rig.cameras.size(), "every camera is told of");
  for (const CameraCalibration& camera : result.cameras) {
    const bool is_needed = result.verdict == Verdict::accepted;
    require(camera.T_world_cam || !is_needed, "an accepted camera has a pose");
    require(camera.covariance || !is_needed, "an accepted camera has a covariance");
    if (camera.T_world_cam)
      require(
          camera.T_world_cam->translation.allFinite() && camera.T_world_cam->rotation.allFinite(),
          "a pose is finite");
    if (camera.covariance) require(camera.covariance->allFinite(), "a covariance is finite");
  }
  to_calibration(parse_json(to_json(result, "").dump(), "written.json"), "written.json");
}

void calibrate_text(std::string_view text) {
  Config config;
  std::vector<SightingRow> rows;
  CalibrateSettings settings;
  if (!is_accepted<InputError>([&] {
        config = parse_config(take_part(text), "rig.toml");
        rows = parse_sightings(take_part(text), "sightings.csv", config.rig);
        check_usable(rows, config.rig, "sightings.csv");
        if (!text.empty())
          settings.guess = to_guess(parse_json(text, "guess.json"), config.rig, "guess.json");
      }))
    return;
  if (config.rig.cameras.size() > most_cameras || rows.size() > most_rows) return;
  std::vector<Throw> throws = labelled_throws(rows);
  std::size_t next = 0;
  const std::vector<FrameSightings> frames = unlabelled_frames(rows);
  for (Throw& found : find_throws(config.rig, [&] {
         return next < frames.size() ? std::optional(frames[next++]) : std::nullopt;
       }))
    throws.push_back(std::move(found));
  check(calibrate(config.rig, throws, settings), config.rig);
}

}  // namespace
}  // namespace throwcal

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  throwcal::calibrate_text(throwcal::text_of(data, size));
  return 0;
}
