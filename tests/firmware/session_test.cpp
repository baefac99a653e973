// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/session.h"

#include <gtest/gtest.h>

#include <random>

#include "firmware/text_file.h"

namespace throwcal {
namespace {

std::shared_ptr<const Calibration> calibration_of(Verdict verdict) {
  auto out = std::make_shared<Calibration>();
  out->verdict = verdict;
  return out;
}

SessionState state_after(SessionState state, SessionEvent event) {
  return outcome(state, event).next;
}

TEST(Session, GoesFromIdleOverCapturingAndSolvingToDone) {
  Session session(2);
  EXPECT_EQ(session.state(), SessionState::idle);
  EXPECT_FALSE(session.id());
  EXPECT_FALSE(session.start(7));
  EXPECT_EQ(session.state(), SessionState::warming_up);
  EXPECT_TRUE(session.is_watching());
  session.cameras_became_warm();
  EXPECT_EQ(session.state(), SessionState::capturing);
  session.flight_found(1);
  EXPECT_EQ(session.state(), SessionState::throw_seen);
  session.calibrated(1, calibration_of(Verdict::needs_more_throws));
  EXPECT_EQ(session.state(), SessionState::capturing);
  EXPECT_FALSE(session.stop());
  EXPECT_EQ(session.state(), SessionState::solving);
  session.calibrated(2, calibration_of(Verdict::needs_more_throws));
  session.solved();
  EXPECT_EQ(session.state(), SessionState::done);
  EXPECT_EQ(session.id(), 7);
  EXPECT_EQ(session.throws(), 2);
  EXPECT_EQ(session.flights(), (std::vector<int>{0, 1}));
}

TEST(Session, EndsItselfOnceEnoughThrowsAgreeAndTheTargetIsReached) {
  Session session(2);
  ASSERT_FALSE(session.start(1));
  session.calibrated(2, calibration_of(Verdict::accepted));
  EXPECT_TRUE(session.is_watching()) << "two throws can agree by chance";
  session.calibrated(3, calibration_of(Verdict::needs_more_throws));
  EXPECT_TRUE(session.is_watching());
  session.calibrated(4, calibration_of(Verdict::accepted));
  EXPECT_EQ(session.state(), SessionState::solving);
}

TEST(Session, GoesOnUntilItIsStoppedWhereThatIsWanted) {
  Session session(2);
  ASSERT_FALSE(session.start(1, {.ends_itself = false}));
  session.calibrated(40, calibration_of(Verdict::accepted));
  EXPECT_TRUE(session.is_watching());
}

TEST(Session, SaysWhyItRefuses) {
  Session session(2);
  EXPECT_EQ(session.stop(), "nothing is being captured (state idle)");
  EXPECT_EQ(session.abort(), "nothing is being captured (state idle)");
  ASSERT_FALSE(session.start(3));
  EXPECT_EQ(session.start(4), "a session is capturing already (state warming-up, session 3)");
  ASSERT_FALSE(session.stop());
  EXPECT_EQ(session.start(4), "a session is still being solved (state solving, session 3)");
  EXPECT_EQ(session.stop(), std::nullopt) << "twice is once";
  EXPECT_EQ(session.id(), 3);
  session.solved();
  EXPECT_EQ(session.abort(), "the session is over and its result is kept (state done, session 3)");
}

TEST(Session, ANewOneBeginsWithNothingOfTheLast) {
  Session session(1);
  ASSERT_FALSE(session.start(1));
  session.flight_found(0);
  session.calibrated(3, calibration_of(Verdict::rejected));
  ASSERT_FALSE(session.stop());
  session.solved();
  ASSERT_FALSE(session.start(2));
  EXPECT_EQ(session.throws(), 0);
  EXPECT_EQ(session.flights(), (std::vector<int>{0}));
  EXPECT_EQ(session.calibration(), nullptr);
}

TEST(Session, OfOneThatIsThrownAwayNothingIsLeft) {
  Session session(1);
  ASSERT_FALSE(session.start(1));
  session.flight_found(0);
  ASSERT_FALSE(session.abort());
  EXPECT_EQ(session.state(), SessionState::idle);
  EXPECT_FALSE(session.id());
  session.flight_found(0);  // it was on its way
  session.calibrated(1, calibration_of(Verdict::accepted));
  session.solved();
  EXPECT_EQ(session.state(), SessionState::idle);
  EXPECT_EQ(session.flights(), (std::vector<int>{0}));
  EXPECT_EQ(session.calibration(), nullptr);
}

TEST(Session, OneOfBeforeARestartIsSolvedFirst) {
  Session session(2);
  ASSERT_FALSE(session.resume_solving(9, {0, 1, 1}));
  EXPECT_EQ(session.state(), SessionState::solving);
  EXPECT_EQ(session.flights(), (std::vector<int>{1, 2}));
  session.solved();
  EXPECT_EQ(session.state(), SessionState::done);
}

TEST(Session, TroubleKeepsOneFromBeginningButDoesNotEndOne) {
  Session session(2);
  session.trouble();
  EXPECT_EQ(session.state(), SessionState::fault);
  EXPECT_EQ(session.start(1), "nothing can be captured until the fault is mended (state fault)");
  session.mended();
  EXPECT_EQ(session.state(), SessionState::idle);
  ASSERT_FALSE(session.start(1));
  session.trouble();
  EXPECT_TRUE(session.is_watching());
}

// --- every event in every state -----------------------------------------------------------------

/// What must hold of each pair, said once more in other words than the table's.
SessionState expected(SessionState state, SessionEvent event) {
  using S = SessionState;
  const bool watching = state == S::warming_up || state == S::capturing || state == S::throw_seen;
  switch (event) {
    case SessionEvent::start:
      return state == S::idle || state == S::done ? S::warming_up : state;
    case SessionEvent::stop:
    case SessionEvent::good_enough:
    case SessionEvent::cameras_ended:
      return watching ? S::solving : state;
    case SessionEvent::abort:
      return watching || state == S::solving ? S::idle : state;
    case SessionEvent::cameras_warm:
      return state == S::warming_up ? S::capturing : state;
    case SessionEvent::flight:
      return state == S::capturing ? S::throw_seen : state;
    case SessionEvent::calibrated:
      return state == S::throw_seen ? S::capturing : state;
    case SessionEvent::solved:
      return state == S::solving ? S::done : state;
    case SessionEvent::resume:
      return state == S::idle || state == S::done ? S::solving : state;
    case SessionEvent::trouble:
      return state == S::idle || state == S::done ? S::fault : state;
    case SessionEvent::mended:
      return state == S::fault ? S::idle : state;
  }
  return state;
}

class EveryPair : public testing::TestWithParam<std::tuple<int, int>> {};

TEST_P(EveryPair, HasTheOutcomeThatItsStoryAsksFor) {
  const auto state = static_cast<SessionState>(std::get<0>(GetParam()));
  const auto event = static_cast<SessionEvent>(std::get<1>(GetParam()));
  EXPECT_EQ(state_after(state, event), expected(state, event));
  const bool is_asked_for = event == SessionEvent::start || event == SessionEvent::stop ||
                            event == SessionEvent::abort || event == SessionEvent::resume;
  const std::string_view refusal = outcome(state, event).refusal;
  if (!refusal.empty()) {
    EXPECT_TRUE(is_asked_for) << "what only happens can't be refused";
    EXPECT_EQ(state_after(state, event), state);
  }
}

INSTANTIATE_TEST_SUITE_P(Session, EveryPair,
                         testing::Combine(testing::Range(0, int{session_states}),
                                          testing::Range(0, int{session_events})),
                         [](const auto& pair) {
                           std::string name =
                               to_string(static_cast<SessionEvent>(std::get<1>(pair.param))) +
                               "_in_" +
                               to_string(static_cast<SessionState>(std::get<0>(pair.param)));
                           std::ranges::replace(name, '-', '_');
                           return name;
                         });

TEST(Session, ItsTableInTheDocumentsIsThatOfTheCode) {
  const std::string document = read_text_file("firmware/session.md");
  EXPECT_NE(document.find(session_table()), std::string::npos)
      << "firmware/session.md must hold what `throwcald --states` prints:\n"
      << session_table();
}

/// One thing that can happen to a session; returns whether it was refused.
bool do_one(Session& session, int what, std::int64_t& last_id) {
  switch (what) {
    case 0:
      return session.start(++last_id, {.ends_itself = last_id % 2 == 0}).has_value();
    case 1:
      return session.stop().has_value();
    case 2:
      return session.abort().has_value();
    case 3:
      session.cameras_became_warm();
      return false;
    case 4:
      session.flight_found(static_cast<CameraId>(last_id % 3));
      return false;
    case 5:
      session.calibrated(4, calibration_of(Verdict::rejected));
      return false;
    case 6:
      session.calibrated(4, calibration_of(Verdict::accepted));
      return false;
    case 7:
      session.cameras_ended();
      return false;
    case 8:
      session.solved();
      return false;
    case 9:
      return session.resume_solving(++last_id, {0, 2}).has_value();
    case 10:
      session.trouble();
      return false;
    default:
      session.mended();
      return false;
  }
}

TEST(Session, AMillionRandomEventsLeaveItInADefinedState) {
  Session session(3);
  std::mt19937_64 random(20261126);
  std::int64_t last_id = 0;
  std::array<int, session_states> visits{};
  for (int i = 0; i < 1'000'000; ++i) {
    const SessionState before = session.state();
    const int what = static_cast<int>(random() % 12);
    const bool refused = do_one(session, what, last_id);
    const auto now = static_cast<std::size_t>(session.state());
    ASSERT_LT(now, session_states);
    ++visits.at(now);
    ASSERT_TRUE(!refused || session.state() == before);
    const bool has_session = session.is_watching() || session.state() == SessionState::solving ||
                             session.state() == SessionState::done;
    ASSERT_TRUE(!has_session || session.id()) << to_string(session.state());
    ASSERT_TRUE(session.state() != SessionState::throw_seen ||
                std::ranges::max(session.flights()) > 0);
    ASSERT_FALSE(to_string(session.state()).empty());
  }
  for (std::size_t s = 0; s < session_states; ++s)
    EXPECT_GT(visits[s], 1000) << to_string(static_cast<SessionState>(s));
}

}  // namespace
}  // namespace throwcal
