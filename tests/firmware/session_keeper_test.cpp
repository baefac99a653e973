// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/session_keeper.h"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <csignal>

#include "tests/support/temporary_folder.h"

namespace throwcal {
namespace {

/// While it lives, no file grows: as on a full disk, SQLite's writes fail.
class NoRoom {
 public:
  NoRoom() {
    getrlimit(RLIMIT_FSIZE, &before_);
    was_handled_ = std::signal(SIGXFSZ, SIG_IGN);
    const rlimit none{1, before_.rlim_max};
    setrlimit(RLIMIT_FSIZE, &none);
  }
  ~NoRoom() {
    setrlimit(RLIMIT_FSIZE, &before_);
    std::signal(SIGXFSZ, was_handled_);
  }

 private:
  rlimit before_{};
  void (*was_handled_)(int);
};

class SessionKeeperTest : public testing::Test {
 protected:
  SessionKeeperTest() { start(); }

  void start() {
    store_.emplace(folder_.path());
    keeper_.emplace(session_, *store_, rig_, false);
  }

  std::optional<std::string> begin() {
    return keeper_->begin({.unit = "box",
                           .software = "throwcal 0",
                           .started_utc = "2026-01-31T11:00:00Z",
                           .rig_toml = "# the rig\n",
                           .cameras = names_},
                          {});
  }

  /// A flight of the session under way, as the estimator posts it.
  void find_flight() {
    BallSighting s;
    s.cov_px2.setIdentity();
    keeper_->take({.session = session_.id().value_or(0), .flights = {Track{0, {s}, true, true}}});
  }

  /// As at the next start of the box.
  void restart() {
    keeper_.reset();
    store_.reset();
    session_ = Session(2);
    start();
  }

  std::string state_of(std::int64_t id) const { return store_->session(id)->at("state"); }

  const std::vector<std::string> names_{"north", "east"};
  const test::TemporaryFolder folder_;
  Session session_{2};
  Rig rig_{{}, {}};
  std::optional<Store> store_;
  std::optional<SessionKeeper> keeper_;
};

TEST_F(SessionKeeperTest, WhatCannotBeStoredIsToldOnceItIs) {
  ASSERT_EQ(begin(), std::nullopt);
  {
    const NoRoom full;
    find_flight();
    EXPECT_NE(keeper_->fault(), std::nullopt);
    EXPECT_EQ(session_.flights()[0], 0);
  }
  keeper_->catch_up();
  EXPECT_EQ(keeper_->fault(), std::nullopt);
  EXPECT_EQ(session_.flights()[0], 1);
}

TEST_F(SessionKeeperTest, AnInterruptedSessionIsSolvedAtTheNextStart) {
  ASSERT_EQ(begin(), std::nullopt);
  find_flight();
  restart();
  const auto unsolved = keeper_->resume(names_, "2026-01-31T12:00:00Z");
  ASSERT_TRUE(unsolved);
  EXPECT_EQ(unsolved->flights.size(), 1u);
  EXPECT_EQ(session_.state(), SessionState::solving);
}

// The power went, and the disk is full when it comes back.
TEST_F(SessionKeeperTest, AnInterruptedSessionWaitsForADiskThatIsFullAtTheStart) {
  ASSERT_EQ(begin(), std::nullopt);
  find_flight();
  const auto cut = folder_.path() / "cut";
  std::filesystem::copy(folder_.path() / "sessions", cut);  // with its log, as the disk has it
  keeper_.reset();
  store_.reset();
  std::filesystem::remove_all(folder_.path() / "sessions");
  std::filesystem::rename(cut, folder_.path() / "sessions");
  std::filesystem::remove(folder_.path() / "reserve");
  session_ = Session(2);
  {
    const NoRoom full;
    start();
    EXPECT_NE(keeper_->fault(), std::nullopt);
    EXPECT_FALSE(keeper_->resume(names_, "2026-01-31T12:00:00Z"));
    EXPECT_THROW((void)store_->file_of(1), StoreError) << "without its log it is not whole";
  }
  keeper_->catch_up();
  EXPECT_EQ(keeper_->fault(), std::nullopt);
  EXPECT_FALSE(store_->session(1)->contains("problem")) << *store_->session(1);
  const auto unsolved = keeper_->resume(names_, "2026-01-31T12:00:00Z");
  ASSERT_TRUE(unsolved);
  EXPECT_EQ(unsolved->flights.size(), 1u);
  EXPECT_EQ(unsolved->facts.rig_toml, "# the rig\n");
}

TEST_F(SessionKeeperTest, AnInterruptedSessionWaitsForTheCamerasToWork) {
  ASSERT_EQ(begin(), std::nullopt);
  find_flight();
  restart();
  session_.trouble();
  EXPECT_FALSE(keeper_->resume(names_, "2026-01-31T12:00:00Z"));
  EXPECT_EQ(store_->open_session(), std::nullopt);
  session_.mended();
  EXPECT_TRUE(keeper_->resume(names_, "2026-01-31T12:00:00Z"));
}

TEST_F(SessionKeeperTest, WhatWasThrownAwayStaysSoThoughTheDiskWasFull) {
  ASSERT_EQ(begin(), std::nullopt);
  const std::int64_t id = *session_.id();
  find_flight();
  {
    const NoRoom full;
    EXPECT_EQ(keeper_->abort(), std::nullopt);
    EXPECT_NE(keeper_->fault(), std::nullopt);
    EXPECT_EQ(session_.state(), SessionState::idle);
  }
  keeper_->catch_up();
  EXPECT_EQ(keeper_->fault(), std::nullopt);
  EXPECT_EQ(state_of(id), "aborted");
  restart();
  EXPECT_EQ(state_of(id), "aborted");
  EXPECT_FALSE(keeper_->resume(names_, "2026-01-31T12:00:00Z"));
}

TEST_F(SessionKeeperTest, TheNextSessionBeginsWithNothingOfTheOneThrownAway) {
  ASSERT_EQ(begin(), std::nullopt);
  const std::int64_t id = *session_.id();
  find_flight();
  {
    const NoRoom full;
    EXPECT_EQ(keeper_->abort(), std::nullopt);
    EXPECT_NE(begin(), std::nullopt) << "it could not be stored";
  }
  ASSERT_EQ(begin(), std::nullopt);
  EXPECT_EQ(state_of(id), "aborted");
  EXPECT_EQ(session_.id(), id + 1);
  EXPECT_EQ(session_.flights()[0], 0);
  EXPECT_EQ(keeper_->calibration_id(), std::nullopt);
}

}  // namespace
}  // namespace throwcal
