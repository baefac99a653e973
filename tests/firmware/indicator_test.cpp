// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/indicator.h"

#include <gtest/gtest.h>

#include <numeric>
#include <set>

#include "firmware/text_file.h"

namespace throwcal {
namespace {

constexpr int step_ms = 10, window_ms = 12'000;

/// On or off, each 10 ms of 12 s, from a moment on.
std::vector<bool> seen(const Blinks& blinks, int from_ms) {
  const bool is_steady = blinks.size() == 1;
  const int period_ms = std::accumulate(blinks.begin(), blinks.end(), 0);
  std::vector<bool> out;
  for (int t = from_ms; t < from_ms + window_ms; t += step_ms) {
    int left = t % period_ms;
    std::size_t i = 0;
    while (left >= blinks[i]) left -= blinks[i++];
    out.push_back(is_steady || i % 2 == 0);
  }
  return out;
}

/// The share of the time in which two differ, at the phase where they differ least.
double difference(const Blinks& a, const Blinks& b) {
  const std::vector<bool> fixed = seen(a, 0);
  double least = 1.0;
  for (int phase = 0; phase < 4'000; phase += step_ms) {
    const std::vector<bool> shifted = seen(b, phase);
    const auto differ = std::inner_product(fixed.begin(), fixed.end(), shifted.begin(), 0,
                                           std::plus<>(), std::not_equal_to<>());
    least = std::min(least, differ / static_cast<double>(fixed.size()));
  }
  return least;
}

std::vector<Shown> all() {
  std::vector<Shown> out;
  for (std::size_t i = 0; i < shown_states; ++i) out.push_back(static_cast<Shown>(i));
  return out;
}

TEST(Indicator, ShowsEachStateInItsOwnWay) {
  double closest = 1.0;
  for (const Shown a : all())
    for (const Shown b : all()) {
      if (a >= b) continue;
      const double d = difference(signal_of(a).blinks, signal_of(b).blinks);
      closest = std::min(closest, d);
      EXPECT_GE(d, 0.1) << to_string(a) << " and " << to_string(b);
    }
  std::cout << "the two that are most alike differ in " << 100.0 * closest << " % of the time\n";
}

TEST(Indicator, ShowsThatAnybodyMayChangeSomething) {
  for (const Shown what : all()) {
    const Blinks open = blinks_of(what, true);
    if (what == Shown::held || what == Shown::refused) {
      EXPECT_EQ(open, blinks_of(what, false)) << "they are over before it is";
      continue;
    }
    for (const Shown other : all())
      EXPECT_GE(difference(open, signal_of(other).blinks), 0.05)
          << to_string(what) << ", open, and " << to_string(other);
  }
}

TEST(Indicator, IsSlowEnoughForAnEyeAndQuickEnoughForAGlance) {
  for (const Shown what : all())
    for (const bool is_open : {false, true}) {
      const Blinks blinks = blinks_of(what, is_open);
      ASSERT_FALSE(blinks.empty());
      EXPECT_TRUE(blinks.size() == 1 || blinks.size() % 2 == 0) << "or on and off change places";
      EXPECT_GE(*std::ranges::min_element(blinks), 50);
      EXPECT_LE(std::accumulate(blinks.begin(), blinks.end(), 0), 3'000);
    }
}

TEST(Indicator, BeepsDifferWithoutTheirPitch) {
  std::set<std::vector<int>> rhythms;
  for (const Shown what : all()) {
    const std::vector<int>& steps = signal_of(what).beep.steps_ms;
    EXPECT_TRUE(steps.empty() || rhythms.insert(steps).second) << to_string(what);
  }
}

TEST(Indicator, EveryStateOfASessionHasASignal) {
  Status status;
  for (std::size_t i = 0; i < session_states; ++i) {
    const auto state = static_cast<SessionState>(i);
    if (state == SessionState::done) continue;
    status.state = state;
    EXPECT_EQ(to_string(shown_of(status, false)), to_string(state));
  }
  status.state = SessionState::done;
  EXPECT_EQ(shown_of(status, false), Shown::done_needs_more);
  for (const Verdict verdict :
       {Verdict::needs_more_throws, Verdict::unobservable, Verdict::rejected}) {
    status.verdict = verdict;
    EXPECT_EQ(shown_of(status, false), Shown::done_needs_more);
  }
  status.verdict = Verdict::accepted;
  EXPECT_EQ(shown_of(status, false), Shown::done);
  status.fault = "the disk is full";
  EXPECT_EQ(shown_of(status, false), Shown::fault);
  EXPECT_EQ(shown_of(status, true), Shown::held);
}

TEST(Indicator, ItsTableInTheDocumentsIsThatOfTheCode) {
  EXPECT_NE(read_text_file("firmware/README.md").find(signal_table()), std::string::npos)
      << "firmware/README.md must hold:\n"
      << signal_table();
}

}  // namespace
}  // namespace throwcal
