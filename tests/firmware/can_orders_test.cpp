// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/can_orders.h"

#include <gtest/gtest.h>

namespace throwcal {
namespace {

using namespace std::chrono_literals;
using Json = JsonRpc::Json;

constexpr std::uint32_t key = 0xCAFEBABE;

/// A box of which only the methods are there.
class CanOrdersTest : public testing::Test {
 protected:
  CanOrdersTest() {
    rpc_.add("status.get", [this](const Json&, JsonRpc::Caller&) -> Json {
      return {{"state", started_ > 0 ? "capturing" : "idle"},
              {"session", started_ > 0 ? Json(started_) : Json()}};
    });
    rpc_.add_change("capture.start", [this](const Json&, JsonRpc::Caller&) -> Json {
      if (is_full_) throw RpcError(rpc_refused, "the disk is full");
      return ++started_;
    });
    rpc_.add_change("capture.stop",
                    [](const Json&, JsonRpc::Caller&) -> Json { throw std::bad_alloc(); });
  }

  CanAck answer(int order, int sequence, std::uint32_t shown = key, int argument = 0) {
    const CanPayload frame = encode(CanCommand{order, sequence, argument, shown});
    return orders_.answer(frame.data(), frame.size(), now_);
  }
  CanOutcome outcome(int order, int sequence, std::uint32_t shown = key) {
    return answer(order, sequence, shown).outcome;
  }

  CanOrders::Clock::time_point now_{1000s};
  bool button_ = false, is_full_ = false;
  std::int64_t started_ = 0;
  int block_ = -1;
  JsonRpc rpc_{[this] { return button_; }};
  CanOrders orders_{rpc_, key, [this](int block) {
                      block_ = block;
                      return CanOutcome::busy;
                    }};
};

TEST_F(CanOrdersTest, StartForWhoKnowsTheKey) {
  const CanAck ack = answer(1, 7);
  EXPECT_EQ(ack.outcome, CanOutcome::ok);
  EXPECT_EQ(ack.order, 1);
  EXPECT_EQ(ack.sequence, 7);
  EXPECT_EQ(can_state_word(ack.state), "capturing");
  EXPECT_EQ(ack.session, 1u);
}

TEST_F(CanOrdersTest, OfAnotherKeyOnceTheBoxHasANewToken) {
  EXPECT_EQ(outcome(1, 7), CanOutcome::ok);
  orders_.set_key(key + 1);
  EXPECT_EQ(outcome(1, 7), CanOutcome::forbidden) << "nor is the old answer given again";
  EXPECT_EQ(outcome(1, 8, key + 1), CanOutcome::ok);
}

TEST_F(CanOrdersTest, AreDoneOnceHoweverOftenTheyCome) {
  for (int i = 0; i < 3; ++i) EXPECT_EQ(outcome(1, 7), CanOutcome::ok);
  EXPECT_EQ(started_, 1);
  EXPECT_EQ(outcome(1, 8), CanOutcome::ok);
  EXPECT_EQ(started_, 2);
  now_ += 5s;
  EXPECT_EQ(outcome(1, 7), CanOutcome::ok);
  EXPECT_EQ(started_, 3) << "another client's, or the same one's 256 commands later";
}

TEST_F(CanOrdersTest, AreTriedAgainWhereTheyFailed) {
  is_full_ = true;
  EXPECT_EQ(outcome(1, 7), CanOutcome::refused);
  is_full_ = false;
  EXPECT_EQ(outcome(1, 7), CanOutcome::ok);
}

TEST_F(CanOrdersTest, AreForbiddenWithoutAKey) {
  for (int i = 0; i < 20; ++i) EXPECT_EQ(outcome(1, i, 0), CanOutcome::forbidden);
  EXPECT_EQ(started_, 0);
  EXPECT_EQ(orders_.wrong_keys(), 0u) << "none is no wrong one";
  button_ = true;
  EXPECT_EQ(outcome(1, 20, 0), CanOutcome::ok);
}

TEST_F(CanOrdersTest, AreLockedAfterAFewWrongKeys) {
  for (int i = 0; i < 4; ++i) EXPECT_EQ(outcome(1, i, key + 1), CanOutcome::forbidden);
  EXPECT_EQ(outcome(1, 4, key + 1), CanOutcome::locked);
  EXPECT_EQ(outcome(1, 5), CanOutcome::locked) << "the right one neither";
  EXPECT_EQ(started_, 0);
  now_ += 9s;
  EXPECT_EQ(outcome(1, 6), CanOutcome::locked);
  now_ += 1s;
  EXPECT_EQ(outcome(1, 7), CanOutcome::ok);
  EXPECT_EQ(started_, 1);
  EXPECT_EQ(orders_.wrong_keys(), 5u);
}

TEST_F(CanOrdersTest, CanBeGuessedAtFiveKeysInTenSeconds) {
  int looked_at = 0;
  for (int tenth = 0; tenth < 6000; ++tenth, now_ += 100ms)  // ten minutes, ten a second
    looked_at += outcome(1, tenth % 256, 1) == CanOutcome::forbidden;
  EXPECT_LE(orders_.wrong_keys(), 300u);
  EXPECT_LT(looked_at, 300);
  EXPECT_EQ(started_, 0);
}

TEST_F(CanOrdersTest, MayBeWrongNowAndThen) {
  for (int i = 0; i < 40; ++i) {
    EXPECT_EQ(outcome(1, i, i % 4 == 3 ? key : 1),
              i % 4 == 3 ? CanOutcome::ok : CanOutcome::forbidden);
    now_ += 5s;
  }
}

TEST_F(CanOrdersTest, AreAnsweredWhateverTheyHold) {
  EXPECT_EQ(outcome(0, 1), CanOutcome::unknown);
  EXPECT_EQ(outcome(255, 1), CanOutcome::unknown);
  EXPECT_EQ(outcome(3, 1), CanOutcome::unknown) << "capture.abort is not there";
  EXPECT_EQ(outcome(2, 1), CanOutcome::refused) << "a method that breaks";
  const CanPayload start = encode(CanCommand{1, 9, 0, key});
  EXPECT_EQ(orders_.answer(start.data(), 7, now_).outcome, CanOutcome::malformed);
  EXPECT_EQ(orders_.answer(start.data(), 0, now_).outcome, CanOutcome::malformed);
  EXPECT_EQ(orders_.answer(start.data(), 7, now_).sequence, 9);
  EXPECT_EQ(started_, 0);
}

TEST_F(CanOrdersTest, GiveADocumentToAnybody) {
  EXPECT_EQ(answer(4, 1, 0, 65535).outcome, CanOutcome::busy);
  EXPECT_EQ(block_, 65535);
  block_ = -1;
  EXPECT_EQ(answer(4, 1, 0, 65535).outcome, CanOutcome::busy);
  EXPECT_EQ(block_, 65535) << "a block that is asked for again is sent again";
}

}  // namespace
}  // namespace throwcal
