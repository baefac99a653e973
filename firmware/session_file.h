// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "estimator/observation.h"
#include "firmware/database.h"

namespace throwcal {

/// What is known of a session when it begins.
struct SessionFacts {
  using Json = nlohmann::ordered_json;

  std::int64_t id = 0;
  std::string unit = {}, software = {};            ///< of the box
  std::string started_utc = {}, stopped_utc = {};  ///< the second empty: it was not stopped
  std::string state = "capturing";                 ///< or "solving", "done", "aborted"
  std::string rig_toml = {};                       ///< the rig file as it was, to the byte
  std::vector<std::string> cameras = {};           ///< their names, in the rig's order
  Json devices = Json::object();  ///< what is behind them, as devices_of() tells it
};

/// A calibration that a session holds.
struct StoredCalibration {
  std::int64_t number = 0;  ///< 1, 2, ... in the session
  std::string created_utc, verdict;
  int throws = 0;            ///< how often somebody had thrown
  std::int64_t flights = 0;  ///< it is of the session's first so many flights
  std::string document;      ///< JSON
};

/// What a sighting looked like (or, of no flight, the background): pixels of one byte, rows from
/// the top.
struct Evidence {
  CameraId camera = 0;
  HostTime time{};
  std::int64_t flight = 0;  ///< 1, 2, ... in the session; 0: the background
  int x_px = 0, y_px = 0;   ///< the picture's pixel that the first one is
  int width = 0, height = 0;
  int step_px = 1;  ///< every so many pixels of the picture, in both axes
  std::string pixels;
};

/// One session in one SQLite file: the rig as it was, sightings, evidence, calibrations. What a
/// call has taken is on the disk when it returns. Throws StoreError: "000007.throwcal: ...", also
/// where what stands in the file can't be.
class SessionFile {
 public:
  /// A new one, all or nothing: it takes its name when it is whole.
  static SessionFile make(const std::filesystem::path& file, const SessionFacts& facts);
  enum class For { writing, reading };
  SessionFile(const std::filesystem::path& file, For what);

  SessionFacts facts() const;
  void set_state(const std::string& state) const;
  void set_stopped(const std::string& utc) const;
  void set_devices(const SessionFacts::Json& devices) const;

  void add_flights(const std::vector<Track>& flights) const;
  /// In the order in which they were found; the first so many.
  std::vector<Track> flights(std::int64_t count = -1) const;

  /// `calibration.number` is given here; of a session the last `kept` stay.
  std::int64_t add_calibration(const StoredCalibration& calibration) const;
  std::vector<StoredCalibration> calibrations() const;  ///< without their documents, oldest first
  /// With its document, whose SHA-256 is checked.
  std::optional<StoredCalibration> calibration(std::int64_t number) const;
  std::optional<StoredCalibration> last_calibration() const;

  void add_evidence(const std::vector<Evidence>& evidence) const;
  std::int64_t evidence_bytes() const;
  void each_evidence(const std::function<void(const Evidence&)>& take) const;
  void drop_evidence() const;  ///< and give its room back to the disk

  void seal() const { database_.seal(); }  ///< nothing more will be written soon

 private:
  void check_schema() const;
  [[noreturn]] void fail(const std::string& what) const;
  BallSighting sighting_of(const Statement& row, CameraId camera) const;
  StoredCalibration calibration_of(const Statement& row, bool with_document) const;

  std::string name_;
  Database database_;
};

}  // namespace throwcal
