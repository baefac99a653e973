// SPDX-License-Identifier: BSD-3-Clause
#include "capture/frame_clock.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "capture/dice.h"
#include "capture/sequence_counter.h"

namespace throwcal {
namespace {

using namespace std::chrono_literals;

constexpr double interval_s = 1.0 / 59.94, exposure_s = 0.004, readout_s = 0.012;
const HostTime start{1234567890123456789ns};

HostTime true_time(int frame) { return start + from_seconds(frame * interval_s); }

TEST(FrameClock, AStampIsKeptToTheNanosecondAndMovedToTheMiddleOfRow0sExposure) {
  const struct {
    TimestampSource source;
    std::chrono::nanoseconds move;
  } cases[] = {{TimestampSource::start_of_exposure, 2ms},
               {TimestampSource::end_of_frame, -14ms},
               {TimestampSource::unknown, 0ms}};
  for (const auto& [source, move] : cases) {
    FrameClock clock(interval_s, exposure_s, readout_s);
    for (int n = 0; n < 40; ++n) {
      const auto moment =
          clock.of({true_time(n), source, true_time(n) + 20ms, static_cast<std::uint64_t>(n)});
      EXPECT_EQ(moment.row0_mid_exposure, true_time(n) + move);
      EXPECT_EQ(moment.source, source);
      if (n > 20) {
        EXPECT_LE(moment.sigma, 2us);
      }
    }
  }
}

TEST(FrameClock, AStampThatCannotBeTrueGivesWayToTheTimeOfDequeueing) {
  FrameClock clock(interval_s, 0, 0);
  const HostTime now = start;
  for (const auto& stamp : {std::optional<HostTime>(), std::optional(now + 5s),
                            std::optional(now - 5s), std::optional(HostTime{})}) {
    const auto moment = clock.of({stamp, TimestampSource::end_of_frame, now, 0});
    EXPECT_EQ(moment.row0_mid_exposure, now);
    EXPECT_EQ(moment.source, TimestampSource::dequeue);
  }
}

TEST(FrameClock, JitterOfStampsIsTheirSigma) {
  FrameClock clock(0, 0, 0);
  Dice dice{3};
  double sigma_s = 0;
  for (int n = 0; n < 2000; ++n) {
    const HostTime stamp = true_time(n) + from_seconds(2e-4 * dice.normal());
    sigma_s = seconds(
        clock.of({stamp, TimestampSource::end_of_frame, stamp + 5ms, static_cast<std::uint64_t>(n)})
            .sigma);
  }
  EXPECT_NEAR(sigma_s, 2e-4, 0.8e-4);  // over 64 frames
}

// A frame is dequeued late by what the scheduler takes: 0.3 ms as a rule, 5 ms now and then.
TEST(FrameClock, DequeuedFramesFollowTheEarliestTheyCanHaveBeen) {
  FrameClock clock(1.0 / 60, 0, 0);  // nominal; it is 59.94
  Dice dice{7};
  double raw_s2 = 0, left_s2 = 0;
  int count = 0;
  for (int n = 0; n < 3000; ++n) {
    if (n % 50 == 7) continue;  // lost frames are no trouble
    double late_s = -3e-4 * std::log(1 - dice.uniform(0, 1));
    if (n % 97 == 0) late_s += 5e-3;
    const auto moment =
        clock.of({std::nullopt, TimestampSource::unknown, true_time(n) + from_seconds(late_s),
                  static_cast<std::uint64_t>(n)});
    if (n < 200) continue;
    raw_s2 += late_s * late_s;
    left_s2 += std::pow(seconds(moment.row0_mid_exposure - true_time(n)), 2);
    ++count;
  }
  EXPECT_GT(std::sqrt(raw_s2 / count), 4e-4);
  EXPECT_LT(std::sqrt(left_s2 / count), 0.1 * std::sqrt(raw_s2 / count));
}

TEST(SequenceCounter, GoesOnBeyondTheWrapAndAfterARestartAndTellsWhatIsLost) {
  SequenceCounter counter;
  EXPECT_EQ(counter.extend(0xfffffffdu), 0u);
  EXPECT_EQ(counter.extend(0xfffffffeu), 1u);
  EXPECT_EQ(counter.extend(2), 5u) << "0xffffffff, 0 and 1 were lost";
  EXPECT_TRUE(counter.counts());
  counter.restart();
  EXPECT_EQ(counter.extend(0), 6u);
  EXPECT_EQ(counter.extend(1), 7u);
  EXPECT_EQ(counter.extend(0), 8u) << "it began anew by itself";
}

TEST(SequenceCounter, ADriverThatDoesNotCountLosesNothing) {
  SequenceCounter counter;
  for (std::uint64_t n = 0; n < 5; ++n) EXPECT_EQ(counter.extend(0), n);
  EXPECT_FALSE(counter.counts());
}

}  // namespace
}  // namespace throwcal
