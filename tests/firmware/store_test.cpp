// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/store.h"

#include <gtest/gtest.h>

#include <fstream>

namespace throwcal {
namespace {

/// A folder of its own that goes with the test.
class StoreTest : public testing::Test {
 protected:
  StoreTest() {
    std::string name = testing::TempDir() + "throwcal-store-XXXXXX";
    folder_ = mkdtemp(name.data());
    rig_.cameras.resize(2);
    rig_.cameras[0].name = "north";
    rig_.cameras[1].name = "east";
  }
  ~StoreTest() override { std::filesystem::remove_all(folder_); }

  Store open() const { return {folder_, rig_}; }

  std::filesystem::path folder_;
  RigDescription rig_;
};

Store::Json document(const std::string& verdict) {
  return {{"created_utc", "2026-01-31T12:00:00Z"}, {"verdict", verdict}};
}

Track flight() {
  BallSighting s;
  s.camera = 1;
  s.time = HostTime(HostClock::duration(1'767'225'600'123'456'789));
  s.center_px = {1.1, 2.2};
  s.cov_px2 << 0.1, 0.02, 0.02, 0.3;
  s.id = 42;
  BallSighting later = s;
  later.time += std::chrono::nanoseconds(1);
  later.radius_px = 3.3;
  return {1, {s, later}};
}

std::string error_of(const std::function<void()>& work) {
  try {
    work();
  } catch (const StoreError& error) {
    return error.what();
  }
  return "no error";
}

TEST_F(StoreTest, IsEmptyAtFirst) {
  const Store store = open();
  EXPECT_FALSE(store.latest_calibration());
  EXPECT_FALSE(store.calibration(1));
  EXPECT_TRUE(store.calibration_list().empty());
  EXPECT_FALSE(store.unsolved_session());
}

TEST_F(StoreTest, CalibrationsSurviveARestartWithTheirIds) {
  std::int64_t first = 0, second = 0;
  {
    Store store = open();
    first = store.start_session("2026-01-31T11:00:00Z");
    store.put_calibration(first, document("needs-more-throws"), 1);
    store.put_calibration(first, document("accepted"), 2);
    store.finish_session(first);
    second = store.start_session("2026-01-31T12:00:00Z");
    store.put_calibration(second, document("rejected"), 3);
  }
  const Store store = open();
  const auto list = store.calibration_list();
  ASSERT_EQ(list.size(), 2u);  // one a session: the newest of each
  EXPECT_EQ(list[0]["session"], second);
  EXPECT_EQ(list[1]["throws"], 2);
  EXPECT_EQ(store.latest_calibration()->at("verdict"), "rejected");
  EXPECT_EQ(store.calibration(list[1]["id"])->at("verdict"), "accepted");
  EXPECT_EQ(store.calibration(list[1]["id"])->at("session"), first);
}

TEST_F(StoreTest, AnInterruptedSessionComesBackWithAllItsFlights) {
  std::int64_t id = 0;
  {
    Store store = open();
    id = store.start_session("");
    store.add_flights(id, {flight()});
    store.stop_session(id, "");
  }
  Store store = open();
  const auto unsolved = store.unsolved_session();
  ASSERT_TRUE(unsolved);
  EXPECT_EQ(unsolved->session, id);
  ASSERT_EQ(unsolved->flights.size(), 1u);
  const Track& back = unsolved->flights[0];
  EXPECT_EQ(back.camera, 1u);
  ASSERT_EQ(back.sightings.size(), 2u);
  const Track expected = flight();
  EXPECT_EQ(back.sightings[0].time, expected.sightings[0].time);
  EXPECT_EQ(back.sightings[0].center_px, expected.sightings[0].center_px);
  EXPECT_EQ(back.sightings[0].cov_px2, expected.sightings[0].cov_px2);
  EXPECT_FALSE(back.sightings[0].radius_px);
  EXPECT_EQ(back.sightings[1].radius_px, 3.3);
  EXPECT_EQ(back.sightings[1].id, 42u);
  store.finish_session(id);
  EXPECT_FALSE(store.unsolved_session());
}

TEST_F(StoreTest, AnInterruptedSessionOfOtherCamerasIsLeftAlone) {
  { open().start_session(""); }
  rig_.cameras[0].name = "south";
  EXPECT_FALSE(open().unsolved_session());
}

TEST_F(StoreTest, ADamagedFileIsNamedWithWhatToDo) {
  std::ofstream(folder_ / "throwcal.db") << std::string(4096, 'x');
  EXPECT_EQ(
      error_of([&] { open(); }),
      (folder_ / "throwcal.db").string() +
          ": file is not a database; the file is damaged: move it away, a new one will be made");
}

TEST_F(StoreTest, ASecondDaemonIsToldThatItIsTheSecond) {
  const Store first = open();
  EXPECT_EQ(error_of([&] { open(); }), (folder_ / "throwcal.db").string() +
                                           ": database is locked; is another throwcald using it?");
}

TEST_F(StoreTest, AFolderThatCannotBeIsNamed) {
  std::ofstream(folder_ / "file") << "x";
  const std::filesystem::path impossible = folder_ / "file" / "state";
  EXPECT_EQ(error_of([&] { Store(impossible, rig_); }),
            impossible.string() + ": can't be made: Not a directory");
}

TEST_F(StoreTest, RemembersWhichDevicesASessionSaw) {
  const Store::Json devices{{"north", {{"serial", "0815"}}}};
  std::int64_t known = 0, unknown = 0;
  {
    Store store = open();
    known = store.start_session("2026-01-31T11:00:00Z", devices);
    unknown = store.start_session("2026-01-31T12:00:00Z");
  }
  const Store store = open();
  EXPECT_EQ(store.devices(known), devices);
  EXPECT_EQ(store.devices(unknown), Store::Json::object());
}

TEST_F(StoreTest, AFileOfVersionOneIsTakenOver) {
  std::int64_t id = 0;
  {
    Store store = open();
    id = store.start_session("2026-01-31T11:00:00Z");
    store.put_calibration(id, document("accepted"), 2);
  }
  {
    const Database database(folder_ / "throwcal.db");
    database.execute("ALTER TABLE session DROP COLUMN devices");
    database.execute("PRAGMA user_version=1");
  }
  Store store = open();
  EXPECT_EQ(store.latest_calibration()->at("verdict"), "accepted");
  EXPECT_EQ(store.devices(id), Store::Json::object());
  EXPECT_GT(store.start_session("2026-01-31T12:00:00Z"), id);
}

TEST_F(StoreTest, AFileOfANewerVersionIsNotTouched) {
  {
    const Database database(folder_ / "throwcal.db");
    database.execute("PRAGMA user_version=99");
  }
  EXPECT_EQ(error_of([&] { open(); }),
            "throwcal.db is of version 99; expected version 2: it was written by a newer throwcal");
}

}  // namespace
}  // namespace throwcal
