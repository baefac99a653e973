// SPDX-License-Identifier: BSD-3-Clause
#include "capture/boot_clock.h"

#include <gtest/gtest.h>

#include <ctime>

namespace throwcal {
namespace {

using namespace std::chrono_literals;

constexpr HostTime about{1000s};

TEST(BootClock, AStampOfTheBootClockIsShifted) {
  EXPECT_EQ(from_boot_time((about + 3600s - 20ms).time_since_epoch() / 1ns, 3600s, about),
            about - 20ms);
}

TEST(BootClock, AStampThatIsOnTheMonotonicClockAfterAllStaysAsItIs) {
  EXPECT_EQ(from_boot_time((about - 20ms).time_since_epoch() / 1ns, 3600s, about), about - 20ms);
}

TEST(BootClock, WhereTheMachineNeverSleptBothAreOne) {
  EXPECT_EQ(from_boot_time(999'980'000'001, 0ns, about), about - 20ms + 1ns);
}

TEST(BootClock, ReadsTheSameUntilTheMachineSleeps) {
  timespec boot{}, monotonic{};
  clock_gettime(CLOCK_MONOTONIC, &monotonic);
  clock_gettime(CLOCK_BOOTTIME, &boot);
  BootClock clock;
  const auto first = clock.suspended();
  EXPECT_LT(std::chrono::abs(first - std::chrono::seconds(boot.tv_sec - monotonic.tv_sec)), 1100ms);
  for (int i = 0; i < 1000; ++i) EXPECT_EQ(clock.suspended(), first);
}

}  // namespace
}  // namespace throwcal
