// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/session_replay.h"

#include "estimator/calibrate.h"
#include "firmware/camera_changes.h"
#include "firmware/cameras.h"
#include "firmware/export.h"
#include "firmware/input_error.h"
#include "firmware/progress_bar.h"
#include "firmware/sha256.h"
#include "firmware/throw_search.h"

namespace throwcal {
namespace {

constexpr std::int64_t all_flights = -1;

std::string dumped(const Json& document) {
  return document.dump(-1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace

SessionReplay::SessionReplay(const std::filesystem::path& file) {
  const SessionFile session(file, SessionFile::For::reading);
  facts_ = session.facts();
  original_ = session.last_calibration();
  flights_ = session.flights(original_ ? original_->flights : all_flights);
  config_ = parse_config(facts_.rig_toml, file.string() + ": its rig file");
  assume_detector_errors(config_.rig);
  std::vector<std::string> names;
  for (const CameraDescription& camera : config_.rig.cameras) names.push_back(camera.name);
  if (names != facts_.cameras)
    throw InputError(file.string() + ": its cameras are not those of its rig file");
}

std::vector<Throw> SessionReplay::throws() const {
  ThrowSearch search(config_.rig);
  for (const Track& flight : flights_) search.add_flight(flight);
  return search.throws();
}

SessionReplay::Json SessionReplay::calibrate_again() const {
  ProgressBar bar("calibrating");
  CalibrateSettings settings;
  settings.progress = [&](double fraction) { bar.show(fraction); };
  const Calibration result = calibrate(config_.rig, throws(), settings);
  Json document = to_json(result, original_ ? original_->created_utc : utc_now());
  add_devices(document, facts_.devices);
  return document;
}

std::string SessionReplay::comparison(const Json& document) const {
  if (!original_) return "the box made no calibration of this session; this is the first";
  const std::string again = dumped(document);
  if (again == original_->document)
    return "the same as the box's, bit for bit (SHA-256 " + sha256_hex(again) + ")";
  const Json theirs = Json::parse(original_->document, nullptr, false);
  const std::string software = theirs.is_object() ? theirs.value("software", "?") : "?";
  return "not the same as the box's, which was made by " + software + "; this is " +
         software_name();
}

}  // namespace throwcal
