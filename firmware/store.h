// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "estimator/observation.h"
#include "estimator/rig_description.h"
#include "firmware/database.h"

namespace throwcal {

/// What the box keeps: sessions, the flights seen in them and the calibrations made of them. What a
/// call has taken is on the disk when it returns. Throws StoreError.
class Store {
 public:
  using Json = nlohmann::ordered_json;

  /// Opens or makes STATE_DIR/throwcal.db (the folder too).
  Store(const std::filesystem::path& state_dir, const RigDescription& rig);

  /// `devices`: what is behind the cameras, as devices_of() tells it.
  std::int64_t start_session(const std::string& utc, const Json& devices = Json::object());
  Json devices(std::int64_t session) const;  ///< an empty object where none were known
  void stop_session(std::int64_t session, const std::string& utc);
  void add_flights(std::int64_t session, const std::vector<Track>& flights);
  /// The session's calibration so far; the one before it is replaced.
  void put_calibration(std::int64_t session, const Json& document, int throws);
  void finish_session(std::int64_t session);

  /// A session that was begun but whose result was never made: the box was switched off. Only the
  /// newest, and only if the rig file still has the same cameras.
  struct Unsolved {
    std::int64_t session = 0;
    std::vector<Track> flights;
  };
  std::optional<Unsolved> unsolved_session() const;

  /// Calibration documents, with their `id` and `session`.
  std::optional<Json> latest_calibration() const;
  std::optional<Json> calibration(std::int64_t id) const;
  Json calibration_list() const;  ///< newest first: id, session, created_utc, verdict, throws

 private:
  void make_tables();
  void migrate();
  std::optional<Json> first_document(Statement statement) const;

  Database database_;
  std::vector<std::string> camera_names_;
};

}  // namespace throwcal
