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

std::string dumped(const Json& document) {
  return document.dump(-1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace

Config config_of(const SessionFacts& facts, const std::string& file) {
  Config out = parse_config(facts.rig_toml, file + ": its rig file");
  assume_detector_errors(out.rig);
  return out;
}

SessionReplay::SessionReplay(const std::filesystem::path& file) {
  const SessionFile session(file, SessionFile::For::reading);
  facts_ = session.facts();
  original_ = session.last_calibration();
  flights_ = session.flights();
  config_ = config_of(facts_, file.string());
  std::vector<std::string> names;
  for (const CameraDescription& camera : config_.rig.cameras) names.push_back(camera.name);
  if (names != facts_.cameras)
    throw InputError(file.string() + ": its cameras are not those of its rig file");
}

std::size_t SessionReplay::calibrated_flights() const {
  if (!original_ || original_->flights < 0) return flights_.size();
  return std::min(flights_.size(), static_cast<std::size_t>(original_->flights));
}

std::vector<Throw> SessionReplay::throws() const { return throws_of(flights_.size()); }

std::vector<Throw> SessionReplay::throws_of(std::size_t flights) const {
  ThrowSearch search(config_.rig);
  for (std::size_t i = 0; i < flights; ++i) search.add_flight(flights_[i]);
  return search.throws();
}

SessionReplay::Json SessionReplay::calibrate_again() const {
  ProgressBar bar("calibrating");
  CalibrateSettings settings;
  settings.progress = [&](double fraction) { bar.show(fraction); };
  const Calibration result = calibrate(config_.rig, throws_of(calibrated_flights()), settings);
  Json document = to_json(result, original_ ? original_->created_utc : utc_now());
  add_devices(document, facts_.devices);
  return document;
}

std::string SessionReplay::comparison(const Json& document) const {
  if (!original_) return "the box made no calibration of this session; this is the first";
  const std::size_t later = flights_.size() - calibrated_flights();
  const std::string rest =
      later == 0
          ? ""
          : "; " + std::to_string(later) +
                " flights that the box found later are in neither (throwcal export --unpack)";
  const std::string again = dumped(document);
  if (again == original_->document)
    return "the same as the box's, bit for bit (SHA-256 " + sha256_hex(again) + ")" + rest;
  const Json theirs = Json::parse(original_->document, nullptr, false);
  const std::string software = theirs.is_object() ? theirs.value("software", "?") : "?";
  return "not the same as the box's, which was made by " + software + "; this is " +
         software_name() + rest;
}

}  // namespace throwcal
