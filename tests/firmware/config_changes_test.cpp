// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/config_changes.h"

#include <gtest/gtest.h>

namespace throwcal {
namespace {

using Names = std::vector<std::string>;

const std::string before =
    "[daemon]\nlisten = 'a:1'\nunit = 'x'\n[target]\nposition_m = 0.005\n[[camera]]\nname = "
    "'north'\nfx_px = 900\n[[camera]]\nname = 'east'\n";

TEST(ConfigChanges, AreNoneOfLayoutAndComments) {
  EXPECT_EQ(config_changes(before, before), Names{});
  EXPECT_EQ(config_changes("[a]\nx = 1\ny = 2\n", "# hello\n\n[a]\ny=2\nx=1 # one\n"), Names{});
}

TEST(ConfigChanges, AreNamedWithTheirTable) {
  std::string after = before;
  after.replace(after.find("0.005"), 5, "0.004");
  after.replace(after.find("900"), 3, "901");
  EXPECT_EQ(config_changes(before, after + "[button]\nkey = 'KEY_A'\n"),
            (Names{"[[camera]] 1 fx_px", "[button] key", "[target] position_m"}));
  EXPECT_EQ(config_changes("[a]\nx = 1\n", "[a]\n"), Names{"[a] x"}) << "what is gone changed";
  EXPECT_EQ(config_changes("[a]\nx = [1, 2]\n", "[a]\nx = [1, 3]\n"), Names{"[a] x"});
  EXPECT_EQ(config_changes(before, before + "[[camera]]\nname = 'south'\n"),
            Names{"[[camera]] 3 name"});
}

TEST(ConfigChanges, AreTakenWhereThatIsSafe) {
  for (const char* change : {"[button] key", "[light] led", "[daemon] unit"})
    EXPECT_EQ(taken(change), Taken::at_once) << change;
  for (const char* change : {"[target] position_m", "[daemon] pre_trigger_s"})
    EXPECT_EQ(taken(change), Taken::between_sessions) << change;
  for (const char* change : {"[daemon] listen", "[[camera]] 1 fx_px", "[ball] mass_kg", "[new] x"})
    EXPECT_EQ(taken(change), Taken::at_restart) << change;
}

}  // namespace
}  // namespace throwcal
