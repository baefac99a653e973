// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/panel_settings.h"

#include <gtest/gtest.h>
#include <linux/input-event-codes.h>

#include "firmware/toml_table.h"

namespace throwcal {
namespace {

ButtonSettings button(const std::string& text) {
  const toml::table table = toml::parse(text);
  return read_button({table, "rig.toml", "[button]"});
}

LightSettings light(const std::string& text) {
  const toml::table table = toml::parse(text);
  return read_light({table, "rig.toml", "[light]"});
}

template <typename Read>
std::string refusal(const Read& read, const std::string& text) {
  try {
    read(text);
  } catch (const InputError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(PanelSettings, AreNothingWhereNothingIsSaid) {
  EXPECT_FALSE(button("").is_there());
  EXPECT_FALSE(light("").is_there());
  EXPECT_EQ(to_toml(button("")) + to_toml(light("")), "");
}

TEST(PanelSettings, OfAButton) {
  const ButtonSettings one = button("key = 'KEY_RECORD'");
  EXPECT_EQ(one.evdev.keys, std::vector<std::uint16_t>{KEY_RECORD});
  EXPECT_EQ(one.times.debounce.count(), 30);
  const ButtonSettings all = button(
      "key = ['KEY_ENTER', 'BTN_LEFT']\ndevice = '/dev/input/by-path/x'\ngrab = true\n"
      "gpio = 'gpiochip2:17'\nactive_low = true\npull = 'up'\ndebounce_s = 0.005");
  EXPECT_EQ(all.evdev.keys, (std::vector<std::uint16_t>{KEY_ENTER, BTN_LEFT}));
  EXPECT_EQ(all.evdev.device, "/dev/input/by-path/x");
  EXPECT_TRUE(all.evdev.grab);
  ASSERT_TRUE(all.gpio);
  EXPECT_EQ(all.gpio->chip, "gpiochip2");
  EXPECT_EQ(all.gpio->line, 17u);
  EXPECT_TRUE(all.gpio->active_low);
  EXPECT_EQ(all.gpio->pull, Pull::up);
  EXPECT_EQ(all.times.debounce.count(), 5);
}

TEST(PanelSettings, OfALight) {
  const LightSettings all =
      light("led = 'green:status'\ngpio = 'gpiochip0:27'\nbeep = '/dev/input/event7'");
  EXPECT_EQ(all.led, "green:status");
  EXPECT_EQ(all.gpio->line, 27u);
  EXPECT_EQ(all.beeper, "/dev/input/event7");
}

TEST(PanelSettings, AreReadBackAsTheyWereWritten) {
  const std::string text =
      "\n[button]\nkey = [\"KEY_RECORD\", \"KEY_A\"]\ndevice = \"/dev/input/a\\\"b\"\ngrab = true\n"
      "gpio = \"gpiochip0:17\"\nactive_low = true\npull = \"down\"\ndebounce_s = 0.03\n"
      "\n[light]\nled = \"green\"\ngpio = \"gpiochip0:27\"\nbeep = \"/dev/input/event7\"\n";
  const toml::table document = toml::parse(text);
  EXPECT_EQ(to_toml(read_button({*document.get_as<toml::table>("button"), "", ""})) +
                to_toml(read_light({*document.get_as<toml::table>("light"), "", ""})),
            text);
}

TEST(PanelSettings, ThatMakeNoSenseAreNamed) {
  const std::string key =
      " must be a key's name in linux/input-event-codes.h like \"KEY_RECORD\", or a list of at "
      "most 16, got ";
  const std::string at = "rig.toml:1: [button] ";
  EXPECT_EQ(refusal(button, "key = 'RECORD'"), at + "key" + key + "\"RECORD\"");
  EXPECT_EQ(refusal(button, "key = 'KEY_RESERVED'"), at + "key" + key + "\"KEY_RESERVED\"");
  EXPECT_EQ(refusal(button, "key = 167"), at + "key must be a list of texts, got 167");
  EXPECT_EQ(refusal(button, "device = '/dev/input/event0'"),
            at + "key is missing; expected the name of a key like \"KEY_RECORD\"");
  EXPECT_EQ(refusal(button, "key = 'KEY_A'\ndevice = '/etc/passwd'"),
            "rig.toml:2: [button] device must be the path of an input device, /dev/input/..., got "
            "\"/etc/passwd\"");
  EXPECT_EQ(refusal(button, "pull = 'up'"), at + "gpio is missing; expected it, as pull is said");
  EXPECT_EQ(refusal(button, "debounce_s = 0.1"), at + "key is missing; expected it or gpio");
  EXPECT_EQ(refusal(button, "key = 'KEY_A'\nhold = 3"),
            "rig.toml:2: [button] hold is not a known key");
  for (const char* bad : {"gpiochip0", "gpiochip0:", "gpiochip0:x", ":17", "gpiochip0:-1",
                          "gpiochip0:65536", "../mem:1", "a/b:1", "gpiochip0:1:2", "gpio chip:1"})
    EXPECT_NE(refusal(light, "gpio = '" + std::string(bad) + "'").find("like \"gpiochip0:17\""),
              std::string::npos)
        << bad;
  for (const char* bad : {"", "..", "a/b", "."})
    EXPECT_NE(refusal(light, "led = '" + std::string(bad) + "'").find("in /sys/class/leds"),
              std::string::npos)
        << bad;
}

}  // namespace
}  // namespace throwcal
