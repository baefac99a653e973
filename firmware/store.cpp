// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/store.h"

#include <algorithm>

namespace throwcal {
namespace {

constexpr std::int64_t schema_version = 2;
constexpr const char* tables = R"(
CREATE TABLE session(id INTEGER PRIMARY KEY AUTOINCREMENT, started_utc TEXT NOT NULL, stopped_utc TEXT,
  state TEXT NOT NULL CHECK(state IN ('capturing', 'solving', 'done')), cameras TEXT NOT NULL,
  devices TEXT NOT NULL DEFAULT '{}');
CREATE TABLE flight(id INTEGER PRIMARY KEY, session INTEGER NOT NULL REFERENCES session(id),
  camera INTEGER NOT NULL);
CREATE INDEX flight_of_session ON flight(session);
CREATE TABLE sighting(flight INTEGER NOT NULL REFERENCES flight(id), time_ns INTEGER NOT NULL,
  u_px REAL NOT NULL, v_px REAL NOT NULL, cov_uu_px2 REAL NOT NULL, cov_uv_px2 REAL NOT NULL,
  cov_vv_px2 REAL NOT NULL, radius_px REAL, number INTEGER NOT NULL);
CREATE INDEX sighting_of_flight ON sighting(flight);
CREATE TABLE calibration(id INTEGER PRIMARY KEY AUTOINCREMENT,
  session INTEGER NOT NULL UNIQUE REFERENCES session(id), created_utc TEXT NOT NULL,
  verdict TEXT NOT NULL, throws INTEGER NOT NULL, document TEXT NOT NULL);
)";

std::filesystem::path prepared(const std::filesystem::path& state_dir) {
  std::error_code error;
  std::filesystem::create_directories(state_dir, error);
  if (error) throw StoreError(state_dir.string() + ": can't be made: " + error.message());
  return state_dir / "throwcal.db";
}

BallSighting sighting_of(const Statement& row, CameraId camera) {
  BallSighting s;
  s.camera = camera;
  s.time = HostTime(HostClock::duration(row.integer(0)));
  s.center_px = {row.number(1), row.number(2)};
  s.cov_px2 << row.number(3), row.number(4), row.number(4), row.number(5);
  s.radius_px = row.optional_number(6);
  s.id = static_cast<std::uint64_t>(row.integer(7));
  return s;
}

}  // namespace

Store::Store(const std::filesystem::path& state_dir, const RigDescription& rig)
    : database_(prepared(state_dir)) {
  for (const CameraDescription& camera : rig.cameras) camera_names_.push_back(camera.name);
  make_tables();
}

void Store::make_tables() {
  Statement version = database_.prepare("PRAGMA user_version");
  version.step();
  const std::int64_t found = version.integer(0);
  version.run();
  if (found == schema_version) return;
  if (found == 1) return migrate();
  if (found != 0)
    throw StoreError("throwcal.db is of version " + std::to_string(found) + "; expected version " +
                     std::to_string(schema_version) + ": it was written by a newer throwcal");
  database_.transaction([&] {
    database_.execute(tables);
    database_.execute("PRAGMA user_version=" + std::to_string(schema_version));
  });
}

/// What was kept by an older throwcal stays.
void Store::migrate() {
  database_.transaction([&] {
    database_.execute("ALTER TABLE session ADD COLUMN devices TEXT NOT NULL DEFAULT '{}'");
    database_.execute("PRAGMA user_version=" + std::to_string(schema_version));
  });
}

std::int64_t Store::start_session(const std::string& utc, const Json& devices) {
  database_
      .prepare(
          "INSERT INTO session(started_utc, state, cameras, devices)"
          " VALUES(?, 'capturing', ?, ?)")
      .bind(utc)
      .bind(Json(camera_names_).dump())
      .bind(devices.dump(-1, ' ', false, Json::error_handler_t::replace))
      .run();
  return database_.last_id();
}

Store::Json Store::devices(std::int64_t session) const {
  Statement row = database_.prepare("SELECT devices FROM session WHERE id = ?");
  row.bind(session);
  return row.step() ? Json::parse(row.text(0)) : Json::object();
}

void Store::stop_session(std::int64_t session, const std::string& utc) {
  database_.prepare("UPDATE session SET stopped_utc = ?, state = 'solving' WHERE id = ?")
      .bind(utc)
      .bind(session)
      .run();
}

void Store::add_flights(std::int64_t session, const std::vector<Track>& flights) {
  if (flights.empty()) return;
  Statement flight = database_.prepare("INSERT INTO flight(session, camera) VALUES(?, ?)");
  Statement sighting = database_.prepare("INSERT INTO sighting VALUES(?, ?, ?, ?, ?, ?, ?, ?, ?)");
  database_.transaction([&] {
    for (const Track& track : flights) {
      flight.bind(session).bind(std::int64_t{track.camera}).run();
      const std::int64_t id = database_.last_id();
      for (const BallSighting& s : track.sightings)
        sighting.bind(id)
            .bind(std::int64_t{s.time.time_since_epoch().count()})
            .bind(s.center_px.x())
            .bind(s.center_px.y())
            .bind(s.cov_px2(0, 0))
            .bind(s.cov_px2(0, 1))
            .bind(s.cov_px2(1, 1))
            .bind(s.radius_px)
            .bind(static_cast<std::int64_t>(s.id))
            .run();
    }
  });
}

void Store::put_calibration(std::int64_t session, const Json& document, int throws) {
  database_
      .prepare(
          "INSERT INTO calibration(session, created_utc, verdict, throws, document)"
          " VALUES(?, ?, ?, ?, ?) ON CONFLICT(session) DO UPDATE SET"
          " created_utc = excluded.created_utc, verdict = excluded.verdict,"
          " throws = excluded.throws, document = excluded.document")
      .bind(session)
      .bind(document.at("created_utc").get<std::string>())
      .bind(document.at("verdict").get<std::string>())
      .bind(std::int64_t{throws})
      .bind(document.dump(-1, ' ', false, Json::error_handler_t::replace))
      .run();
}

void Store::finish_session(std::int64_t session) {
  database_.prepare("UPDATE session SET state = 'done' WHERE id = ?").bind(session).run();
}

std::optional<Store::Unsolved> Store::unsolved_session() const {
  Statement newest =
      database_.prepare("SELECT id, state, cameras FROM session ORDER BY id DESC LIMIT 1");
  if (!newest.step() || newest.text(1) == "done") return {};
  if (newest.text(2) != Json(camera_names_).dump()) return {};
  Unsolved out{newest.integer(0), {}};
  Statement flights = database_.prepare("SELECT id, camera FROM flight WHERE session = ?");
  flights.bind(out.session);
  while (flights.step()) {
    const auto camera = static_cast<CameraId>(flights.integer(1));
    Statement rows = database_.prepare(
        "SELECT time_ns, u_px, v_px, cov_uu_px2, cov_uv_px2, cov_vv_px2, radius_px, number"
        " FROM sighting WHERE flight = ? ORDER BY time_ns");
    rows.bind(flights.integer(0));
    Track& track = out.flights.emplace_back(Track{camera, {}});
    while (rows.step()) track.sightings.push_back(sighting_of(rows, camera));
  }
  return out;
}

std::optional<Store::Json> Store::first_document(Statement statement) const {
  if (!statement.step()) return {};
  Json document = Json::parse(statement.text(2));
  document["id"] = statement.integer(0);
  document["session"] = statement.integer(1);
  return document;
}

std::optional<Store::Json> Store::latest_calibration() const {
  return first_document(database_.prepare(
      "SELECT id, session, document FROM calibration ORDER BY session DESC LIMIT 1"));
}

std::optional<Store::Json> Store::calibration(std::int64_t id) const {
  Statement statement =
      database_.prepare("SELECT id, session, document FROM calibration WHERE id = ?");
  statement.bind(id);
  return first_document(std::move(statement));
}

Store::Json Store::calibration_list() const {
  Json out = Json::array();
  Statement rows = database_.prepare(
      "SELECT id, session, created_utc, verdict, throws FROM calibration ORDER BY session DESC"
      " LIMIT 1000");
  while (rows.step())
    out.push_back({{"id", rows.integer(0)},
                   {"session", rows.integer(1)},
                   {"created_utc", rows.text(2)},
                   {"verdict", rows.text(3)},
                   {"throws", rows.integer(4)}});
  return out;
}

}  // namespace throwcal
