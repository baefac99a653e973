// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/store.h"

#include <gtest/gtest.h>

#include <fstream>

#include "tests/support/temporary_folder.h"

namespace throwcal {
namespace {

class StoreTest : public testing::Test {
 protected:
  /// A session with a calibration of that verdict; over where `state` says so.
  std::int64_t add_session(Store& store, const std::string& verdict, const std::string& state) {
    const std::int64_t id = store.start_session(facts());
    if (!verdict.empty()) store.add_calibration(calibration(verdict));
    if (!state.empty()) store.finish_session(state);
    return id;
  }

  static SessionFacts facts() {
    return {.unit = "box",
            .software = "throwcal 0",
            .started_utc = "2026-01-31T11:00:00Z",
            .rig_toml = "# the rig\n",
            .cameras = {"north", "east"},
            .devices = {{"north", {{"serial", "0815"}}}}};
  }

  static StoredCalibration calibration(const std::string& verdict) {
    return {0, "2026-01-31T12:00:00Z", verdict, 2, 4, R"({"verdict":")" + verdict + R"("})"};
  }

  std::filesystem::path file(const char* name) const { return folder_ / "sessions" / name; }

  const test::TemporaryFolder temporary_;
  const std::filesystem::path& folder_ = temporary_.path();
};

Track flight() {
  BallSighting s;
  s.camera = 1;
  s.time = HostTime(HostClock::duration(1'767'225'600'123'456'789));
  s.center_px = {1.1, 2.2};
  s.cov_px2 << 0.1, 0.02, 0.02, 0.3;
  s.id = (std::uint64_t{1} << 40) + 42;
  BallSighting later = s;
  later.time += std::chrono::nanoseconds(1);
  later.radius_px = 3.3;
  later.is_partial = true;
  return {1, {s, later}, true, false};
}

Evidence picture(std::int64_t of_flight, int side) {
  return {1,
          HostTime(HostClock::duration(7)),
          of_flight,
          3,
          4,
          side,
          side,
          2,
          std::string(static_cast<std::size_t>(side) * side, '\x80')};
}

std::string error_of(const std::function<void()>& work) {
  try {
    work();
  } catch (const StoreError& error) {
    return error.what();
  }
  return "no error";
}

void expect_same(const Track& a, const Track& b) {
  EXPECT_EQ(a.camera, b.camera);
  EXPECT_EQ(a.begins_clear, b.begins_clear);
  EXPECT_EQ(a.ends_clear, b.ends_clear);
  ASSERT_EQ(a.sightings.size(), b.sightings.size());
  for (std::size_t i = 0; i < a.sightings.size(); ++i) {
    const BallSighting &x = a.sightings[i], &y = b.sightings[i];
    EXPECT_EQ(x.camera, y.camera);
    EXPECT_EQ(x.time, y.time);
    EXPECT_EQ(x.center_px, y.center_px);
    EXPECT_EQ(x.cov_px2, y.cov_px2);
    EXPECT_EQ(x.radius_px, y.radius_px);
    EXPECT_EQ(x.id, y.id);
    EXPECT_EQ(x.is_partial, y.is_partial);
  }
}

TEST_F(StoreTest, IsEmptyAtFirst) {
  Store store(folder_);
  store.ready();
  EXPECT_FALSE(store.latest_calibration());
  EXPECT_FALSE(store.calibration(10'001));
  EXPECT_TRUE(store.calibration_list().empty());
  EXPECT_TRUE(store.session_list().empty());
  EXPECT_FALSE(store.resume({"north", "east"}));
}

TEST_F(StoreTest, CalibrationsSurviveARestartWithTheirIds) {
  std::int64_t first = 0, second = 0, first_calibration = 0;
  {
    Store store(folder_);
    first = add_session(store, "needs-more-throws", "");
    first_calibration = store.add_calibration(calibration("accepted"));
    store.finish_session("done");
    second = add_session(store, "rejected", "");
  }
  Store store(folder_);
  store.ready();
  const auto list = store.calibration_list();
  ASSERT_EQ(list.size(), 2u);  // one a session: the newest of each
  EXPECT_EQ(list[0]["session"], second);
  EXPECT_EQ(list[1]["throws"], 2);
  EXPECT_EQ(list[1]["id"], first_calibration);
  EXPECT_EQ(store.latest_calibration()->at("verdict"), "rejected");
  EXPECT_EQ(store.calibration(first_calibration)->at("verdict"), "accepted");
  EXPECT_EQ(store.calibration(first_calibration)->at("session"), first);
  EXPECT_EQ(store.calibration(first_calibration - 1)->at("verdict"), "needs-more-throws");
  EXPECT_FALSE(store.calibration(first_calibration + 1));
  EXPECT_FALSE(store.calibration(-1));
}

TEST_F(StoreTest, OfASessionThatWasThrownAwayNoCalibrationIsTheLatest) {
  Store store(folder_);
  add_session(store, "accepted", "done");
  const std::int64_t away = add_session(store, "rejected", "aborted");
  EXPECT_EQ(store.latest_calibration()->at("verdict"), "accepted");
  EXPECT_EQ(store.calibration_list().size(), 1u);
  EXPECT_EQ(store.session(away)->at("state"), "aborted");
  EXPECT_EQ(store.session(away)->at("calibrations").size(), 1u);
}

TEST_F(StoreTest, AnInterruptedSessionComesBackWithAllItsFlights) {
  std::int64_t id = 0;
  {
    Store store(folder_);
    id = store.start_session(facts());
    store.add_flights({flight()});
    store.stop_session("2026-01-31T12:00:00Z");
    store.add_flights({flight()});
  }
  {
    Store store(folder_);
    const auto unsolved = store.resume({"north", "east"});
    ASSERT_TRUE(unsolved);
    EXPECT_EQ(unsolved->session, id);
    ASSERT_EQ(unsolved->flights.size(), 2u);
    expect_same(unsolved->flights[0], flight());
    EXPECT_EQ(store.facts().stopped_utc, "2026-01-31T12:00:00Z");
    store.finish_session("done");
    EXPECT_FALSE(store.resume({"north", "east"}));
  }
  EXPECT_FALSE(Store(folder_).resume({"north", "east"}));
}

TEST_F(StoreTest, AnInterruptedSessionWhoseFlightsCannotBeReadIsToldAndLeftAlone) {
  {
    Store store(folder_);
    store.start_session(facts());
    store.add_flights({flight()});
  }
  Database(file("000001.throwcal"), Database::Mode::write).execute("DELETE FROM sighting");
  Store store(folder_);
  EXPECT_NE(error_of([&] {
              store.resume({"north", "east"});
            }).find("has no sightings"),
            std::string::npos);
  EXPECT_EQ(store.open_session(), std::nullopt);
  EXPECT_FALSE(store.resume({"north", "east"}));
  EXPECT_TRUE(store.session(1)->contains("problem"));
  EXPECT_NE(error_of([&] { (void)store.file_of(1); }).find("has no sightings"), std::string::npos);
  EXPECT_EQ(store.start_session(facts()), 2);
  store.delete_session(1);
  EXPECT_EQ(store.session_list().size(), 1u);
}

TEST_F(StoreTest, AnInterruptedSessionOfOtherCamerasIsLeftAlone) {
  { Store(folder_).start_session(facts()); }
  Store store(folder_);
  EXPECT_FALSE(store.resume({"south", "east"}));
  EXPECT_EQ(store.session_list()[0]["state"], "interrupted");
}

TEST_F(StoreTest, KeepsWhatASessionWasMadeWith) {
  std::int64_t id = 0;
  {
    Store store(folder_);
    id = add_session(store, "", "done");
  }
  Store store(folder_);
  store.ready();
  const SessionFacts back = SessionFile(*store.file_of(id), SessionFile::For::reading).facts();
  EXPECT_EQ(back.id, id);
  EXPECT_EQ(back.rig_toml, facts().rig_toml);
  EXPECT_EQ(back.cameras, facts().cameras);
  EXPECT_EQ(back.devices, facts().devices);
  EXPECT_EQ(back.software, "throwcal 0");
  EXPECT_EQ(store.session(id)->at("unit"), "box");
}

TEST_F(StoreTest, EvidenceComesBackAndGoesFirst) {
  Store store(folder_);
  const std::int64_t id = store.start_session(facts());
  store.add_flights({flight()});
  std::vector<Evidence> many(1000, picture(1, 40));
  store.add_evidence(many);
  store.add_calibration(calibration("accepted"));
  store.finish_session("done");
  const std::filesystem::path path = *store.file_of(id);
  const auto before = std::filesystem::file_size(path);
  {
    const SessionFile session(path, SessionFile::For::writing);
    std::size_t count = 0;
    session.each_evidence([&](const Evidence& e) {
      EXPECT_EQ(e.pixels, many[0].pixels);
      EXPECT_EQ(e.step_px, 2);
      EXPECT_EQ(e.flight, 1);
      ++count;
    });
    EXPECT_EQ(count, many.size());
    EXPECT_EQ(session.evidence_bytes(), 1600 * 1000);
    session.drop_evidence();
    session.seal();
  }
  EXPECT_LT(std::filesystem::file_size(path), before / 10);
  EXPECT_TRUE(store.latest_calibration());
  EXPECT_EQ(SessionFile(path, SessionFile::For::reading).flights().size(), 1u);
}

TEST_F(StoreTest, EvidenceThatThereIsNoRoomForMakesRoomOldestFirst) {
  const auto free = std::filesystem::space(folder_).available;
  std::vector<std::int64_t> ids;
  {
    Store roomy(folder_);
    for (int i = 0; i < 3; ++i) {
      ids.push_back(add_session(roomy, "accepted", ""));
      roomy.add_evidence({picture(1, 40)});
      roomy.finish_session("done");
    }
  }
  Store full(folder_, {.keep_free_bytes = 2 * free});  // as if the disk were full
  full.start_session(facts());
  EXPECT_THROW(full.add_evidence({picture(1, 40)}), StoreError);
  for (const std::int64_t id : ids) {
    EXPECT_FALSE(full.session(id)->at("has_evidence"));
    EXPECT_EQ(full.session(id)->at("verdict"), "accepted");
  }
  EXPECT_FALSE(full.session(*full.open_session())->at("has_evidence"));
}

TEST_F(StoreTest, KeepsTheLastCalibrationsOfASession) {
  Store store(folder_);
  const std::int64_t id = store.start_session(facts());
  std::int64_t last = 0;
  for (int i = 0; i < 25; ++i) last = store.add_calibration(calibration("accepted"));
  EXPECT_EQ(store.session(id)->at("calibrations").size(), 20u);
  EXPECT_EQ(store.latest_calibration()->at("id"), last);
  EXPECT_EQ(last, id * 10'000 + 25);
}

TEST_F(StoreTest, ANumberIsNeverGivenTwice) {
  std::int64_t id = 0;
  {
    Store store(folder_);
    id = add_session(store, "accepted", "done");
    store.delete_session(id);
    EXPECT_FALSE(store.session(id));
    EXPECT_FALSE(store.latest_calibration());
  }
  Store store(folder_);
  EXPECT_EQ(store.start_session(facts()), id + 1);
  EXPECT_NE(error_of([&] { store.delete_session(id + 1); }).find("under way"), std::string::npos);
  EXPECT_NE(error_of([&] { store.delete_session(99); }).find("not there"), std::string::npos);
}

TEST_F(StoreTest, ADamagedFileIsToldAndTheOthersServe) {
  {
    Store store(folder_);
    add_session(store, "accepted", "done");
    add_session(store, "rejected", "done");
  }
  std::ofstream(file("000002.throwcal")) << std::string(4096, 'x');
  Store store(folder_);
  store.ready();
  EXPECT_EQ(store.session(2)->at("problem"),
            file("000002.throwcal").string() +
                ": file is not a database; the file is damaged, or not one of throwcal's");
  EXPECT_EQ(store.latest_calibration()->at("verdict"), "accepted");
  EXPECT_EQ(store.start_session(facts()), 3);
}

TEST_F(StoreTest, ADamagedCalibrationIsNotGivenOut) {
  std::int64_t id = 0;
  {
    Store store(folder_);
    add_session(store, "accepted", "");
    id = store.latest_calibration()->at("id");
    store.finish_session("done");
  }
  {
    const Database database(file("000001.throwcal"), Database::Mode::write);
    database.execute("UPDATE calibration SET document = replace(document, 'accepted', 'rejected')");
  }
  Store store(folder_);
  store.ready();
  EXPECT_NE(error_of([&] { store.calibration(id); }).find("is damaged"), std::string::npos);
}

TEST_F(StoreTest, ASecondDaemonIsToldThatItIsTheSecond) {
  const Store first(folder_);
  EXPECT_EQ(error_of([&] { Store second(folder_); }),
            folder_.string() + ": another throwcald is using it");
}

TEST_F(StoreTest, ANoteThatCannotBeReadIsToldUntilItCan) {
  std::filesystem::create_directories(folder_ / "last-session");
  Store store(folder_);
  EXPECT_NE(error_of([&] { store.ready(); }), "no error");
  std::filesystem::remove(folder_ / "last-session");
  store.ready();
  EXPECT_EQ(store.start_session(facts()), 1);
}

TEST_F(StoreTest, AFolderThatCannotBeIsToldUntilItCan) {
  std::ofstream(folder_ / "file") << "x";
  const std::filesystem::path impossible = folder_ / "file" / "state";
  Store store(impossible);
  EXPECT_EQ(error_of([&] { store.ready(); }),
            impossible.string() +
                ": can't be used: Not a directory; expected a folder that this user may write to");
  EXPECT_NE(error_of([&] { store.start_session(facts()); }), "no error");
  EXPECT_TRUE(store.session_list().empty());
  std::filesystem::remove(folder_ / "file");
  store.ready();
  EXPECT_EQ(store.start_session(facts()), 1);
}

TEST_F(StoreTest, ADraftOfAFileThatWasNeverWholeGoes) {
  { Store(folder_).ready(); }
  std::ofstream(file("000001.throwcal.new")) << "half a file";
  Store store(folder_);
  store.ready();
  EXPECT_FALSE(std::filesystem::exists(file("000001.throwcal.new")));
  EXPECT_EQ(store.start_session(facts()), 1);
}

TEST_F(StoreTest, AFileThatWasLeftInTheMiddleOfAWriteIsMended) {
  {
    Store store(folder_);
    add_session(store, "accepted", "done");
  }
  const std::filesystem::path path = file("000001.throwcal"), other = folder_ / "copy";
  {
    // A rollback journal that a power cut leaves, copied while a transaction is under way.
    const Database database(path, Database::Mode::make);
    database.execute("PRAGMA cache_size=1; BEGIN IMMEDIATE");
    for (int i = 0; i < 200; ++i)
      database.execute(
          "INSERT INTO calibration(created_utc, verdict, throws, flights, sha256,"
          " document) VALUES('', '', 0, 0, '', hex(randomblob(4000)))");
    std::filesystem::copy(path, other);
    std::filesystem::copy(path.string() + "-journal", other.string() + "-journal");
  }
  std::filesystem::rename(other, path);
  std::filesystem::rename(other.string() + "-journal", path.string() + "-journal");
  Store store(folder_);
  store.ready();
  EXPECT_FALSE(store.session(1)->contains("problem")) << *store.session(1);
  EXPECT_EQ(store.session(1)->at("calibrations").size(), 1u);
  EXPECT_EQ(store.latest_calibration()->at("verdict"), "accepted");
}

// --- a file that somebody sends us --------------------------------------------------------------

class ForeignSession : public StoreTest {
 protected:
  /// What reading everything says of a good file after `sql`.
  std::string read_after(const std::string& sql) const {
    const std::filesystem::path path = folder_ / "foreign.throwcal";
    std::filesystem::remove(path);
    {
      const SessionFile made = SessionFile::make(path, facts());
      made.add_flights({flight()});
      made.add_calibration(calibration("accepted"));
      made.add_evidence({picture(1, 4)});
      made.seal();
    }
    {
      const Database database(path, Database::Mode::write);
      database.execute(sql);
      database.seal();
    }
    const std::string error = error_of([&] {
      const SessionFile session(path, SessionFile::For::reading);
      (void)session.facts();
      (void)session.flights();
      (void)session.last_calibration();
      session.each_evidence([](const Evidence&) {});
    });
    const std::string prefix = path.string() + ": ";
    return error.starts_with(prefix) ? error.substr(prefix.size()) : error;
  }
};

TEST_F(ForeignSession, IsReadWhereItIsOneOfOurs) { EXPECT_EQ(read_after(""), "no error"); }

TEST_F(ForeignSession, OfAnotherVersionOrApplicationIsRefused) {
  EXPECT_EQ(read_after("PRAGMA user_version=99"),
            "is of version 99; expected version 1: it was written by a newer throwcal");
  EXPECT_EQ(read_after("PRAGMA application_id=7"),
            "is not a session of throwcal's (another application's file)");
}

TEST_F(ForeignSession, WithTablesOfItsOwnIsRefused) {
  const std::string refusal = "holds other tables than a session of throwcal's";
  EXPECT_EQ(read_after("CREATE TABLE more(x)"), refusal);
  EXPECT_EQ(read_after("CREATE VIEW v AS SELECT 1"), refusal);
  EXPECT_EQ(read_after("CREATE TRIGGER t AFTER INSERT ON flight BEGIN DELETE FROM sighting; END"),
            refusal);
  EXPECT_EQ(read_after("DROP TABLE flight"), refusal);
}

TEST_F(ForeignSession, WithValuesThatCannotBeIsRefused) {
  const std::string no_sighting = "a sighting of camera 2 can't be one";
  EXPECT_EQ(read_after("UPDATE sighting SET u_px = 9e999"), no_sighting);
  EXPECT_EQ(read_after("UPDATE sighting SET v_px = -1e6"), no_sighting);
  EXPECT_EQ(read_after("UPDATE sighting SET cov_uu_px2 = -1"), no_sighting);
  EXPECT_EQ(read_after("UPDATE sighting SET cov_uv_px2 = 5"), no_sighting);
  EXPECT_EQ(read_after("UPDATE sighting SET radius_px = -3"), no_sighting);
  EXPECT_EQ(read_after("UPDATE sighting SET time_ns = 9223372036854775807 WHERE radius_px"),
            no_sighting);
  EXPECT_EQ(read_after("UPDATE sighting SET time_ns = time_ns + 30000000000 WHERE radius_px"),
            "flight 1: it lasts longer than 20 s");
  EXPECT_EQ(read_after("UPDATE flight SET camera = 2"), "flight 1: there is no camera 2");
  EXPECT_EQ(read_after("UPDATE flight SET camera = -1"), "flight 1: there is no camera -1");
  EXPECT_EQ(read_after("DELETE FROM sighting"), "flight 1: it has no sightings");
  EXPECT_EQ(read_after("DELETE FROM session"), "holds no session");
  EXPECT_EQ(read_after("UPDATE session SET cameras = '[1]'"),
            "session: cameras must be a list of names");
  EXPECT_EQ(read_after("UPDATE session SET devices = 'x'"), "session: devices must be an object");
  EXPECT_EQ(read_after("UPDATE evidence SET width = 5"),
            "evidence 1: its size is not that of its pixels");
  EXPECT_EQ(read_after("UPDATE evidence SET height = -4, width = -4"),
            "evidence 1: its size is not that of its pixels");
}

TEST_F(ForeignSession, ThatIsNotThereIsNamed) {
  EXPECT_EQ(error_of([&] { SessionFile(folder_ / "none", SessionFile::For::reading); }),
            (folder_ / "none").string() +
                ": unable to open database file; expected a folder that this user may write to");
}

}  // namespace
}  // namespace throwcal
