// SPDX-License-Identifier: BSD-3-Clause
// firmware/throwcald.toml is the manual of every key: it can't go stale.
#include <gtest/gtest.h>

#include <filesystem>
#include <regex>
#include <set>
#include <sstream>

#include "firmware/config.h"
#include "firmware/text_file.h"

namespace throwcal {
namespace {

const std::string file = "firmware/throwcald.toml";

/// With what is commented out: "#key = value".
std::string with_every_key() {
  return std::regex_replace(read_text_file(file), std::regex("(^|\n)#([a-z0-9_]+ = )"), "$1$2");
}

/// The names that follow a pattern, each once.
std::set<std::string> names(const std::string& text, const std::regex& pattern) {
  std::set<std::string> out;
  for (auto hit = std::sregex_iterator(text.begin(), text.end(), pattern);
       hit != std::sregex_iterator(); ++hit)
    out.insert((*hit)[1]);
  return out;
}

/// Of every source that reads a TomlTable: what it asks for.
std::set<std::string> keys_read() {
  const std::regex asks(
      "\\b(?:number|required_number|integer|required_integer|boolean|text|choice|numbers|texts|"
      "text_or_texts|device)\\((?:table, )?\"([a-z0-9_]+)\"");
  std::set<std::string> out;
  for (const auto& entry : std::filesystem::directory_iterator("firmware")) {
    if (entry.path().extension() != ".cpp") continue;
    const std::string text = read_text_file(entry.path());
    if (text.find("TomlTable") != text.npos) out.merge(names(text, asks));
  }
  return out;
}

TEST(ThrowcaldToml, IsReadWithoutAWarning) {
  const Config config = read_config(file);
  EXPECT_EQ(config.warnings, std::vector<std::string>{});
  EXPECT_EQ(config.rig.cameras.size(), 2u);
}

TEST(ThrowcaldToml, SoItIsWithEveryKeyInIt) {
  const Config config = parse_config(with_every_key(), file, "firmware");
  EXPECT_EQ(config.warnings, std::vector<std::string>{});
  EXPECT_TRUE(config.button.is_there() && config.light.is_there());
  EXPECT_EQ(config.rig.cameras[0].estimate.size(), 3u);
}

TEST(ThrowcaldToml, HoldsEveryKeyThatIsRead) {
  const std::set<std::string> told = names(with_every_key(), std::regex("(?:^|\n)([a-z0-9_]+) = "));
  const std::set<std::string> read = keys_read();
  EXPECT_GT(read.size(), 50u) << "or the pattern finds them no more";
  for (const std::string& key : read) EXPECT_TRUE(told.contains(key)) << key << " is missing";
  for (const std::string& key : told)
    EXPECT_TRUE(read.contains(key)) << key << " is read by nobody";
}

/// What a commented number claims to be the default is.
TEST(ThrowcaldToml, ItsSimulationIsTheDefault) {
  const SimulatedSceneSettings told = parse_config(with_every_key(), file, "firmware").simulation;
  const SimulatedSceneSettings ours = read_config(file).simulation;
  EXPECT_EQ(told.seed, ours.seed);
  EXPECT_EQ(told.cameras, ours.cameras);
  EXPECT_EQ(told.side_m, ours.side_m);
  EXPECT_EQ(told.width_px, ours.width_px);
  EXPECT_EQ(told.height_px, ours.height_px);
  EXPECT_EQ(told.focal_px, ours.focal_px);
  EXPECT_EQ(told.frames_per_s, ours.frames_per_s);
  EXPECT_EQ(told.max_offset_s, ours.max_offset_s);
  EXPECT_EQ(told.drag_per_m, ours.drag_per_m);
  EXPECT_EQ(told.row_time_s, ours.row_time_s);
  EXPECT_EQ(told.throw_interval_s, ours.throw_interval_s);
  EXPECT_EQ(told.exposure_s, ours.exposure_s);
}

TEST(ThrowcaldToml, TheDaemonsDefaultsAreThoseOfTheCode) {
  const Config told = parse_config(with_every_key(), file, "firmware"), ours = read_config(file);
  EXPECT_EQ(told.listen.host, ours.listen.host);
  EXPECT_EQ(told.listen.port, ours.listen.port);
  EXPECT_EQ(told.pre_trigger, ours.pre_trigger);
  EXPECT_EQ(told.button.times.debounce, ours.button.times.debounce);
}

}  // namespace
}  // namespace throwcal
