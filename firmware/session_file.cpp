// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/session_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <set>

#include "firmware/sha256.h"

namespace throwcal {
namespace {

using Json = SessionFacts::Json;

constexpr std::int64_t application = 0x74686361;  // "thca"
constexpr std::int64_t schema_version = 1;
constexpr std::int64_t calibrations_kept = 20;
constexpr std::size_t max_cameras = 64, max_flight_sightings = 100'000;
constexpr int max_side_px = 65536;

// auto_vacuum, or the room of what is deleted would never be the disk's again.
constexpr const char* before_tables = "PRAGMA auto_vacuum=INCREMENTAL";
constexpr std::array tables{
    "CREATE TABLE session(id INTEGER PRIMARY KEY, unit TEXT NOT NULL, software TEXT NOT NULL, "
    "started_utc TEXT NOT NULL, stopped_utc TEXT NOT NULL, state TEXT NOT NULL, "
    "rig_toml TEXT NOT NULL, cameras TEXT NOT NULL, devices TEXT NOT NULL)",
    "CREATE TABLE flight(id INTEGER PRIMARY KEY, camera INTEGER NOT NULL, "
    "begins_clear INTEGER NOT NULL, ends_clear INTEGER NOT NULL)",
    "CREATE TABLE sighting(flight INTEGER NOT NULL, time_ns INTEGER NOT NULL, u_px REAL NOT NULL, "
    "v_px REAL NOT NULL, cov_uu_px2 REAL NOT NULL, cov_uv_px2 REAL NOT NULL, "
    "cov_vv_px2 REAL NOT NULL, radius_px REAL, number INTEGER NOT NULL, partial INTEGER NOT NULL, "
    "PRIMARY KEY(flight, time_ns)) WITHOUT ROWID",
    "CREATE TABLE calibration(number INTEGER PRIMARY KEY, created_utc TEXT NOT NULL, "
    "verdict TEXT NOT NULL, throws INTEGER NOT NULL, flights INTEGER NOT NULL, "
    "sha256 TEXT NOT NULL, document TEXT NOT NULL)",
    "CREATE TABLE evidence(id INTEGER PRIMARY KEY, camera INTEGER NOT NULL, "
    "time_ns INTEGER NOT NULL, flight INTEGER NOT NULL, x_px INTEGER NOT NULL, "
    "y_px INTEGER NOT NULL, width INTEGER NOT NULL, height INTEGER NOT NULL, "
    "step_px INTEGER NOT NULL, pixels BLOB NOT NULL)"};

std::string dumped(const Json& value) {
  return value.dump(-1, ' ', false, Json::error_handler_t::replace);
}

void sync_folder(const std::filesystem::path& folder) {
  const int fd = open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd < 0) return;
  fsync(fd);
  close(fd);
}

/// Of what may stand in a file that somebody sends us.
bool is_possible(const BallSighting& s) {
  const double uu = s.cov_px2(0, 0), uv = s.cov_px2(0, 1), vv = s.cov_px2(1, 1);
  const auto within = [](double value, double low, double high) {
    return value >= low && value <= high;  // false for NaN
  };
  return within(std::abs(s.center_px.x()), 0, 1e5) && within(std::abs(s.center_px.y()), 0, 1e5) &&
         within(uu, 1e-12, 1e8) && within(vv, 1e-12, 1e8) && uu * vv - uv * uv > 0 &&
         (!s.radius_px || within(*s.radius_px, 0, 1e5)) &&
         std::abs(seconds(s.time.time_since_epoch())) < 4e9;
}

}  // namespace

SessionFile SessionFile::make(const std::filesystem::path& file, const SessionFacts& facts) {
  const std::filesystem::path draft = file.string() + ".new";
  std::error_code error;  // what can't be removed, SQLite will tell of
  std::filesystem::remove(draft, error);
  std::filesystem::remove(draft.string() + "-journal", error);
  {
    const Database made(draft, Database::Mode::make);
    made.execute(before_tables);
    made.transaction([&] {
      for (const char* table : tables) made.execute(table);
      made.prepare("INSERT INTO session VALUES(?, ?, ?, ?, ?, ?, ?, ?, ?)")
          .bind(facts.id)
          .bind(facts.unit)
          .bind(facts.software)
          .bind(facts.started_utc)
          .bind(facts.stopped_utc)
          .bind(facts.state)
          .bind(facts.rig_toml)
          .bind(dumped(facts.cameras))
          .bind(dumped(facts.devices))
          .run();
      made.execute("PRAGMA application_id=" + std::to_string(application));
      made.execute("PRAGMA user_version=" + std::to_string(schema_version));
    });
  }
  std::filesystem::rename(draft, file, error);
  if (error) throw StoreError(file.string() + ": can't be put in place: " + error.message());
  sync_folder(file.parent_path());
  return {file, For::writing};
}

SessionFile::SessionFile(const std::filesystem::path& file, For what)
    : name_(file.string()),
      database_(file, what == For::writing ? Database::Mode::write : Database::Mode::read) {
  check_schema();
}

void SessionFile::fail(const std::string& what) const { throw StoreError(name_ + ": " + what); }

/// Exactly our tables: a foreign file's views and triggers would be code.
void SessionFile::check_schema() const {
  const auto number = [&](const char* pragma) {
    Statement row = database_.prepare(pragma);
    return row.step() ? row.integer(0) : 0;
  };
  if (number("PRAGMA application_id") != application)
    fail("is not a session of throwcal's (another application's file)");
  if (const auto version = number("PRAGMA user_version"); version != schema_version)
    fail("is of version " + std::to_string(version) + "; expected version " +
         std::to_string(schema_version) + ": it was written by a newer throwcal");
  std::multiset<std::string> found;
  Statement rows = database_.prepare("SELECT coalesce(sql, '') FROM sqlite_schema");
  while (rows.step()) found.insert(rows.text(0));
  found.erase("");
  if (found != std::multiset<std::string>(tables.begin(), tables.end()))
    fail("holds other tables than a session of throwcal's");
}

SessionFacts SessionFile::facts() const {
  Statement row = database_.prepare("SELECT * FROM session LIMIT 1");
  if (!row.step()) fail("holds no session");
  SessionFacts out{row.integer(0), row.text(1), row.text(2), row.text(3),   row.text(4),
                   row.text(5),    row.text(6), {},          Json::object()};
  const Json cameras = Json::parse(row.text(7), nullptr, false);
  out.devices = Json::parse(row.text(8), nullptr, false);
  if (!cameras.is_array() || cameras.size() > max_cameras ||
      !std::ranges::all_of(cameras, [](const Json& name) { return name.is_string(); }))
    fail("session: cameras must be a list of names");
  if (!out.devices.is_object()) fail("session: devices must be an object");
  for (const Json& name : cameras) out.cameras.push_back(name.get<std::string>());
  return out;
}

void SessionFile::set_state(const std::string& state) const {
  database_.prepare("UPDATE session SET state = ?").bind(state).run();
}

void SessionFile::set_stopped(const std::string& utc) const {
  database_.prepare("UPDATE session SET state = 'solving', stopped_utc = ?").bind(utc).run();
}

void SessionFile::set_devices(const Json& devices) const {
  database_.prepare("UPDATE session SET devices = ?").bind(dumped(devices)).run();
}

void SessionFile::add_flights(const std::vector<Track>& flights) const {
  if (flights.empty()) return;
  Statement flight =
      database_.prepare("INSERT INTO flight(camera, begins_clear, ends_clear) VALUES(?, ?, ?)");
  Statement sighting =
      database_.prepare("INSERT INTO sighting VALUES(?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
  database_.transaction([&] {
    for (const Track& track : flights) {
      flight.bind(std::int64_t{track.camera})
          .bind(std::int64_t{track.begins_clear})
          .bind(std::int64_t{track.ends_clear})
          .run();
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
            .bind(std::int64_t{s.is_partial})
            .run();
    }
  });
}

BallSighting SessionFile::sighting_of(const Statement& row, CameraId camera) const {
  BallSighting s;
  s.camera = camera;
  s.time = HostTime(HostClock::duration(row.integer(0)));
  s.center_px = {row.number(1), row.number(2)};
  s.cov_px2 << row.number(3), row.number(4), row.number(4), row.number(5);
  s.radius_px = row.optional_number(6);
  s.id = static_cast<std::uint64_t>(row.integer(7));
  s.is_partial = row.integer(8) != 0;
  if (!is_possible(s)) fail("a sighting of camera " + std::to_string(camera + 1) + " can't be one");
  return s;
}

std::vector<Track> SessionFile::flights(std::int64_t count) const {
  std::vector<Track> out;
  const std::size_t cameras = facts().cameras.size();
  Statement flights = database_.prepare(
      "SELECT id, camera, begins_clear, ends_clear FROM flight ORDER BY id LIMIT ?");
  flights.bind(count);
  while (flights.step()) {
    const std::string name = "flight " + std::to_string(flights.integer(0));
    if (flights.integer(1) < 0 || flights.integer(1) >= static_cast<std::int64_t>(cameras))
      fail(name + ": there is no camera " + std::to_string(flights.integer(1)));
    const auto camera = static_cast<CameraId>(flights.integer(1));
    Statement rows = database_.prepare(
        "SELECT time_ns, u_px, v_px, cov_uu_px2, cov_uv_px2, cov_vv_px2, radius_px, number, partial"
        " FROM sighting WHERE flight = ? ORDER BY time_ns");
    rows.bind(flights.integer(0));
    Track& track =
        out.emplace_back(Track{camera, {}, flights.integer(2) != 0, flights.integer(3) != 0});
    while (rows.step() && track.sightings.size() < max_flight_sightings)
      track.sightings.push_back(sighting_of(rows, camera));
    if (track.sightings.empty()) fail(name + ": it has no sightings");
    if (track.sightings.back().time - track.sightings.front().time > std::chrono::seconds(20))
      fail(name + ": it lasts longer than 20 s");
  }
  return out;
}

std::int64_t SessionFile::add_calibration(const StoredCalibration& calibration) const {
  std::int64_t number = 0;
  database_.transaction([&] {
    database_
        .prepare(
            "INSERT INTO calibration(created_utc, verdict, throws, flights, sha256, document)"
            " VALUES(?, ?, ?, ?, ?, ?)")
        .bind(calibration.created_utc)
        .bind(calibration.verdict)
        .bind(std::int64_t{calibration.throws})
        .bind(calibration.flights)
        .bind(sha256_hex(calibration.document))
        .bind(calibration.document)
        .run();
    number = database_.last_id();
    database_.prepare("DELETE FROM calibration WHERE number <= ?")
        .bind(number - calibrations_kept)
        .run();
  });
  return number;
}

StoredCalibration SessionFile::calibration_of(const Statement& row, bool with_document) const {
  StoredCalibration out{row.integer(0), row.text(1), row.text(2), static_cast<int>(row.integer(3)),
                        row.integer(4), {}};
  if (!with_document) return out;
  out.document = row.text(6);
  if (sha256_hex(out.document) != row.text(5))
    fail("calibration " + std::to_string(out.number) + " is damaged: its SHA-256 is another");
  return out;
}

std::vector<StoredCalibration> SessionFile::calibrations() const {
  std::vector<StoredCalibration> out;
  Statement rows = database_.prepare(
      "SELECT number, created_utc, verdict, throws, flights FROM calibration ORDER BY number");
  while (rows.step()) out.push_back(calibration_of(rows, false));
  return out;
}

std::optional<StoredCalibration> SessionFile::calibration(std::int64_t number) const {
  Statement row = database_.prepare("SELECT * FROM calibration WHERE number = ?");
  row.bind(number);
  return row.step() ? std::optional(calibration_of(row, true)) : std::nullopt;
}

std::optional<StoredCalibration> SessionFile::last_calibration() const {
  Statement row = database_.prepare("SELECT * FROM calibration ORDER BY number DESC LIMIT 1");
  return row.step() ? std::optional(calibration_of(row, true)) : std::nullopt;
}

void SessionFile::add_evidence(const std::vector<Evidence>& evidence) const {
  if (evidence.empty()) return;
  Statement row = database_.prepare(
      "INSERT INTO evidence(camera, time_ns, flight, x_px, y_px, width, height, step_px, pixels)"
      " VALUES(?, ?, ?, ?, ?, ?, ?, ?, ?)");
  database_.transaction([&] {
    for (const Evidence& e : evidence)
      row.bind(std::int64_t{e.camera})
          .bind(std::int64_t{e.time.time_since_epoch().count()})
          .bind(e.flight)
          .bind(std::int64_t{e.x_px})
          .bind(std::int64_t{e.y_px})
          .bind(std::int64_t{e.width})
          .bind(std::int64_t{e.height})
          .bind(std::int64_t{e.step_px})
          .bind_bytes(e.pixels)
          .run();
  });
}

std::int64_t SessionFile::evidence_bytes() const {
  Statement row = database_.prepare("SELECT coalesce(sum(length(pixels)), 0) FROM evidence");
  return row.step() ? row.integer(0) : 0;
}

void SessionFile::each_evidence(const std::function<void(const Evidence&)>& take) const {
  Statement row = database_.prepare("SELECT * FROM evidence ORDER BY id");
  while (row.step()) {
    const auto number = [&](int column) {
      return static_cast<int>(std::clamp<std::int64_t>(row.integer(column), -1, max_side_px));
    };
    const Evidence e{static_cast<CameraId>(number(1)),
                     HostTime(HostClock::duration(row.integer(2))),
                     row.integer(3),
                     number(4),
                     number(5),
                     number(6),
                     number(7),
                     number(8),
                     row.text(9)};
    if (number(1) < 0 || e.width <= 0 || e.height <= 0 || e.step_px <= 0 ||
        e.pixels.size() != static_cast<std::size_t>(e.width) * static_cast<std::size_t>(e.height))
      fail("evidence " + std::to_string(row.integer(0)) + ": its size is not that of its pixels");
    take(e);
  }
}

/// Two steps, each of which needs next to no room: freed pages need no journal.
void SessionFile::drop_evidence() const {
  database_.execute("DELETE FROM evidence");
  database_.execute("PRAGMA incremental_vacuum");
}

}  // namespace throwcal
