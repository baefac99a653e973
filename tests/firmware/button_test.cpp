// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/button.h"

#include <gtest/gtest.h>

#include <random>

namespace throwcal {
namespace {

using namespace std::chrono_literals;
using std::chrono::milliseconds;

const Button::Time started(1000s);

/// What happens to a contact, and what must come of it, in milliseconds since the box started.
struct Story {
  const char* name;
  int found_down_ms;          ///< -1: it was up at the first look
  std::vector<int> edges_ms;  ///< down, up, down, ... (up, down, ... if found down)
  std::vector<std::pair<int, Press>> presses;  ///< and when they are told
};

std::ostream& operator<<(std::ostream& out, const Story& story) { return out << story.name; }

constexpr Press shortly = Press::short_press, abortion = Press::abort, reset = Press::factory_reset;

const Story stories[] = {
    {"APressIsToldOnceItsReleaseHasKeptStill", -1, {20'000, 20'200}, {{20'230, shortly}}},
    {"TwoPresses", -1, {20'000, 20'200, 20'300, 20'400}, {{20'230, shortly}, {20'430, shortly}}},
    {"BounceTrainsOfClosingAndOpeningAreOnePress",
     -1,
     {20'000, 20'001, 20'003, 20'004, 20'009, 20'300, 20'302, 20'303},
     {{20'333, shortly}}},
    {"ALongTrainIsOnePress",
     -1,
     {20'000, 20'020, 20'040, 20'060, 20'080, 20'100, 20'120, 20'300},
     {{20'330, shortly}}},
    {"ASpikeIsNone", -1, {20'000, 20'029}, {}},
    {"ASpikeWhileDownIsNoRelease", -1, {20'000, 20'500, 20'529, 20'800}, {{20'830, shortly}}},
    {"JustShortOfAnAbort", -1, {20'000, 22'999}, {{23'029, shortly}}},
    {"HeldForThreeSeconds", -1, {20'000, 23'500}, {{23'000, abortion}}},
    {"HeldForThreeSecondsToTheMillisecond", -1, {20'000, 23'000}, {{23'000, abortion}}},
    {"ASpikeAtThreeSecondsPutsTheAbortOff",
     -1,
     {20'000, 22'990, 23'005, 24'000},
     {{23'005, abortion}}},
    {"Stuck", -1, {20'000}, {{23'000, abortion}}},
    {"HeldForTenSecondsLaterIsAnAbortOnly", -1, {20'000, 31'000}, {{23'000, abortion}}},
    {"HeldForTenSecondsSinceTheStart", 0, {10'500}, {{10'000, reset}}},
    {"FoundSoonAfterTheStart", 5'000, {}, {{15'000, reset}}},
    {"FoundTooLateForAReset", 5'001, {40'000}, {}},
    {"ReleasedBeforeTenSecondsIsNothing", 0, {9'999}, {}},
    {"ASpikeDoesNotEndTheReset", 0, {5'000, 5'020}, {{10'000, reset}}},
    {"StuckSinceTheStartResetsOnce", 0, {}, {{10'000, reset}}},
    {"WorksAfterItWasFoundDown", 5'001, {6'000, 7'000, 7'100}, {{7'130, shortly}}},
    {"WorksAfterAReset", 0, {11'000, 12'000, 12'100}, {{10'000, reset}, {12'130, shortly}}},
    {"PressedRightAfterTheStartIsAPress", -1, {1'000, 1'200}, {{1'230, shortly}}},
    {"PressedAndHeldRightAfterTheStartIsAnAbort", -1, {1'000, 15'000}, {{4'000, abortion}}},
};

using Told = std::vector<std::pair<int, Press>>;

int ms_since_start(Button::Time time) {
  return static_cast<int>(std::chrono::duration_cast<milliseconds>(time - started).count());
}

/// Plays a story as the main loop does: advance() when next() says so, edges as they come.
Told played(const Story& story, const ButtonTimes& times = {}) {
  Button button(started, times);
  Told out;
  const auto note = [&](std::optional<Press> press, Button::Time at) {
    if (press) out.emplace_back(ms_since_start(at), *press);
  };
  Button::Time now = started;
  const auto wait_until = [&](Button::Time end) {
    for (auto next = button.next(); next && *next <= end; next = button.next()) {
      now = std::max(now, *next);
      note(button.advance(now), now);
    }
    now = end;
  };
  bool is_down = story.found_down_ms >= 0;
  if (is_down) button.found_down(started + milliseconds(story.found_down_ms));
  for (const int ms : story.edges_ms) {
    is_down = !is_down;
    wait_until(started + milliseconds(ms));
    note(button.edge(is_down, started + milliseconds(ms)), started + milliseconds(ms));
  }
  wait_until(started + 1h);
  EXPECT_EQ(button.next(), std::nullopt) << "nothing is due any more";
  return out;
}

class EveryStory : public testing::TestWithParam<Story> {};

TEST_P(EveryStory, EndsAsItMust) { EXPECT_EQ(played(GetParam()), GetParam().presses); }

/// The loop was busy and sees all of it in one go: the edges' own times count.
TEST_P(EveryStory, IsTheSameWhereTheLoopWasLate) {
  const Story& story = GetParam();
  Button button(started);
  std::vector<Press> presses, expected;
  const auto note = [&](std::optional<Press> press) {
    if (press) presses.push_back(*press);
  };
  bool is_down = story.found_down_ms >= 0;
  if (is_down) button.found_down(started + milliseconds(story.found_down_ms));
  for (const int ms : story.edges_ms)
    note(button.edge(is_down = !is_down, started + milliseconds(ms)));
  note(button.advance(started + 1h));
  for (const auto& [at, press] : story.presses) expected.push_back(press);
  EXPECT_EQ(presses, expected);
}

INSTANTIATE_TEST_SUITE_P(Button, EveryStory, testing::ValuesIn(stories),
                         [](const auto& story) { return story.param.name; });

TEST(Button, WithoutDebouncingBothEdgesAtOnceAreAPress) {
  ButtonTimes times;
  times.debounce = 0ms;
  EXPECT_EQ(played({"", -1, {20'000, 20'000}, {}}, times), (Told{{20'000, shortly}}));
  EXPECT_EQ(played({"", -1, {20'000, 24'000}, {}}, times), (Told{{23'000, abortion}}));
}

TEST(Button, RepeatedEdgesAreNone) {
  Button button(started);
  EXPECT_FALSE(button.edge(false, started + 20s)) << "it was up already";
  EXPECT_FALSE(button.edge(true, started + 21s));
  for (int ms = 250; ms < 2000; ms += 33)
    EXPECT_FALSE(button.edge(true, started + 21s + milliseconds(ms)));
  EXPECT_FALSE(button.edge(false, started + 23s));
  EXPECT_EQ(button.advance(started + 23030ms), Press::short_press);
}

TEST(Button, TimesThatGoBackCountAsTheNewest) {
  Button button(started);
  EXPECT_FALSE(button.advance(started + 30s));
  EXPECT_FALSE(button.edge(true, started + 29s));
  EXPECT_EQ(button.next(), started + 30030ms);
  EXPECT_FALSE(button.edge(false, started + 1s));
  EXPECT_FALSE(button.advance(started + 2s)) << "down for no time: a spike";
  EXPECT_FALSE(button.advance(started + 31s));
  EXPECT_EQ(button.next(), std::nullopt);
}

TEST(Button, IsHeldWhileItMeansSomething) {
  Button button(started);
  EXPECT_FALSE(button.is_held());
  (void)button.edge(true, started + 20s);
  EXPECT_FALSE(button.is_held()) << "a spike, for all we know";
  (void)button.advance(started + 20030ms);
  EXPECT_TRUE(button.is_held());
  (void)button.advance(started + 23s);
  EXPECT_FALSE(button.is_held()) << "the abort is told; a stuck button must not hide the state";
}

/// A contact that does whatever it likes, and what a button makes of it.
struct RandomContact {
  std::mt19937_64 random{20261126};
  int shorts = 0, aborts = 0, resets = 0;

  void count(Press press) {
    shorts += press == Press::short_press;
    aborts += press == Press::abort;
    resets += press == Press::factory_reset;
  }
  int told() const { return shorts + aborts + resets; }

  /// Mostly bounces, sometimes seconds.
  milliseconds wait() {
    const auto longest = random() % 3 == 0 ? 8'000 : 40;
    return milliseconds(random() % longest);
  }

  void play_one() {
    Button button(started);
    Button::Time now = started, up_until = started;  // it kept still at "up" until then
    bool is_down = random() % 4 == 0;
    if (is_down) button.found_down(now);
    const int told_before = told();
    int quiet_releases = 0;
    for (int step = 0; step < 60; ++step) {
      const Button::Time next = now + wait();
      const int told_before_wait = told();
      for (Button::Time at = now; at <= next; at += 10ms)
        if (const auto press = button.advance(at)) {
          count(*press);
          EXPECT_EQ(is_down, *press != Press::short_press);
          EXPECT_TRUE(!is_down || at - up_until >= (*press == Press::abort ? 3s : 10s));
        }
      if (const auto press = button.edge(!is_down, next)) count(*press);
      EXPECT_LE(told() - told_before_wait, 1) << "one press at most while the contact keeps still";
      if (!is_down && next - now >= 30ms) {
        ++quiet_releases;
        up_until = next;
      }
      is_down = !is_down;
      now = next;
    }
    EXPECT_LE(told() - told_before, quiet_releases + 1);
  }
};

TEST(Button, ARandomContactGivesNoMorePressesThanItMay) {
  RandomContact contact;
  for (int round = 0; round < 2'000 && !testing::Test::HasFailure(); ++round) contact.play_one();
  EXPECT_GT(contact.shorts, 1'000);
  EXPECT_GT(contact.aborts, 1'000);
  EXPECT_GT(contact.resets, 10);
  std::cout << contact.shorts << " short presses, " << contact.aborts << " aborts, "
            << contact.resets << " resets\n";
}

}  // namespace
}  // namespace throwcal
