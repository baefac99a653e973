// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/session.h"

#include <gtest/gtest.h>

namespace throwcal {
namespace {

std::shared_ptr<const Calibration> some_calibration() { return std::make_shared<Calibration>(); }

TEST(Session, GoesFromIdleOverCapturingAndSolvingToDone) {
  Session session(2);
  EXPECT_EQ(session.state(), SessionState::idle);
  EXPECT_FALSE(session.id());
  EXPECT_FALSE(session.start(7, true));
  EXPECT_EQ(session.state(), SessionState::capturing);
  session.flight_found(1);
  session.calibrated(1, some_calibration());
  EXPECT_FALSE(session.stop());
  EXPECT_EQ(session.state(), SessionState::solving);
  session.calibrated(2, some_calibration());
  session.solved();
  EXPECT_EQ(session.state(), SessionState::done);
  EXPECT_EQ(session.id(), 7);
  EXPECT_EQ(session.throws(), 2);
  EXPECT_EQ(session.flights(), (std::vector<int>{0, 1}));
}

TEST(Session, WaitsForTheCamerasToLearnTheirBackground) {
  Session session(2);
  EXPECT_FALSE(session.start(1, false));
  EXPECT_EQ(session.state(), SessionState::warming_up);
  EXPECT_TRUE(session.is_watching());
  session.cameras_became_warm();
  EXPECT_EQ(session.state(), SessionState::capturing);
}

TEST(Session, SaysWhyItRefuses) {
  Session session(2);
  EXPECT_EQ(session.stop(), "nothing is being captured (state idle)");
  ASSERT_FALSE(session.start(3, true));
  EXPECT_EQ(session.start(4, true), "session 3 is capturing already");
  ASSERT_FALSE(session.stop());
  EXPECT_EQ(session.start(4, true), "session 3 is still being solved");
  EXPECT_EQ(session.stop(), "nothing is being captured (state solving)");
  EXPECT_EQ(session.id(), 3);
}

TEST(Session, ANewOneBeginsWithNothingOfTheLast) {
  Session session(1);
  ASSERT_FALSE(session.start(1, true));
  session.flight_found(0);
  session.calibrated(3, some_calibration());
  ASSERT_FALSE(session.stop());
  session.solved();
  ASSERT_FALSE(session.start(2, true));
  EXPECT_EQ(session.throws(), 0);
  EXPECT_EQ(session.flights(), (std::vector<int>{0}));
  EXPECT_EQ(session.calibration(), nullptr);
}

TEST(Session, OneOfBeforeARestartIsSolvedFirst) {
  Session session(2);
  session.resume_solving(9, {0, 1, 1});
  EXPECT_EQ(session.state(), SessionState::solving);
  EXPECT_EQ(session.flights(), (std::vector<int>{1, 2}));
  session.solved();
  EXPECT_EQ(session.state(), SessionState::done);
}

TEST(Session, LateNewsDoNotChangeTheState) {
  Session session(1);
  session.solved();
  session.cameras_became_warm();
  EXPECT_EQ(session.state(), SessionState::idle);
}

}  // namespace
}  // namespace throwcal
