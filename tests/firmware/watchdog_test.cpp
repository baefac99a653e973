// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/watchdog.h"

#include <gtest/gtest.h>

#include <cstdlib>

namespace throwcal {
namespace {

using namespace std::chrono_literals;

const Movement::Time start(100s);

Movement::Seen camera(std::uint64_t frames, bool may_rest = false) {
  return {.name = "camera \"north\"", .may_rest = may_rest, .steps = frames};
}

TEST(Movement, WhoMovesIsNotStuck) {
  Movement movement;
  for (int s = 0; s < 100; s += 4)
    EXPECT_FALSE(
        movement.stuck({camera(static_cast<std::uint64_t>(s))}, start + std::chrono::seconds(s)));
}

TEST(Movement, WhoStandsStillIsStuckAfterItsPatience) {
  Movement movement;
  EXPECT_FALSE(movement.stuck({camera(7)}, start));
  EXPECT_FALSE(movement.stuck({camera(7)}, start + 5s));
  EXPECT_EQ(movement.stuck({camera(7)}, start + 5001ms), "camera \"north\"");
  EXPECT_FALSE(movement.stuck({camera(8)}, start + 6s)) << "it moves again";
}

TEST(Movement, WhoNeverMovedIsStuck) {
  Movement movement;
  EXPECT_FALSE(movement.stuck({camera(0)}, start));
  EXPECT_TRUE(movement.stuck({camera(0)}, start + 6s));
}

TEST(Movement, WhoMayRestIsNot) {
  Movement movement;
  EXPECT_FALSE(movement.stuck({camera(7, true)}, start));
  EXPECT_FALSE(movement.stuck({camera(7, true)}, start + 60s));
  EXPECT_FALSE(movement.stuck({camera(7)}, start + 64s)) << "its patience begins with its work";
  EXPECT_TRUE(movement.stuck({camera(7)}, start + 66s));
}

TEST(Movement, OneOfManyIsNamed) {
  Movement movement;
  const auto all = [](std::uint64_t frames, std::uint64_t turns) {
    return std::vector<Movement::Seen>{
        camera(frames),
        {.name = "the estimator", .steps = turns, .patience = Movement::estimator_patience}};
  };
  EXPECT_FALSE(movement.stuck(all(0, 0), start));
  EXPECT_FALSE(movement.stuck(all(1, 0), start + 30s));
  EXPECT_EQ(movement.stuck(all(2, 0), start + 31s), "the estimator");
  EXPECT_EQ(movement.stuck(all(2, 1), start + 37s), "camera \"north\"");
}

TEST(Movement, PetsTwiceInTheTimeThatSystemdGives) {
  unsetenv("WATCHDOG_USEC");
  EXPECT_FALSE(watchdog_period());
  setenv("WATCHDOG_USEC", "10000000", 1);
  EXPECT_EQ(watchdog_period(), 5s);
  setenv("WATCHDOG_USEC", "nonsense", 1);
  EXPECT_FALSE(watchdog_period());
  unsetenv("WATCHDOG_USEC");
}

}  // namespace
}  // namespace throwcal
