// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "firmware/button.h"

namespace throwcal {

class TomlTable;

enum class Pull { as_is, none, up, down };

/// One line of a GPIO chip, and how it is wired.
struct GpioLineSettings {
  std::string chip;  ///< "gpiochip0", in /dev
  std::uint32_t line = 0;
  bool active_low = false;
  Pull pull = Pull::as_is;  ///< of an input
};

/// Keys of input devices: keyboards, remote controls, foot switches, gpio-keys.
struct EvdevSettings {
  std::vector<std::uint16_t> keys;  ///< codes of linux/input-event-codes.h
  std::filesystem::path device;     ///< empty: every one that has such a key
  bool grab = false;                ///< nobody else gets the device's keys
};

/// [button] of the rig file.
struct ButtonSettings {
  EvdevSettings evdev;
  std::optional<GpioLineSettings> gpio;
  ButtonTimes times;

  bool is_there() const { return !evdev.keys.empty() || gpio; }
};

/// [light] of the rig file.
struct LightSettings {
  std::string led;  ///< in /sys/class/leds
  std::optional<GpioLineSettings> gpio;
  std::filesystem::path beeper;  ///< an input device that sounds

  bool is_there() const { return !led.empty() || gpio || !beeper.empty(); }
};

/// They throw InputError as TomlTable does, for keys that they don't know, too.
ButtonSettings read_button(TomlTable table);
LightSettings read_light(TomlTable table);

/// As they stand in a rig file, with a blank line before; nothing of what is not there.
std::string to_toml(const ButtonSettings& button);
std::string to_toml(const LightSettings& light);

/// "gpiochip0:17": chip and line. Nothing where it is not that.
std::optional<GpioLineSettings> parse_gpio_line(std::string_view text);

/// "gpiochip0:17"
std::string to_string(const GpioLineSettings& line);

/// "KEY_RECORD", as linux/input-event-codes.h names it.
std::string name_of_key(std::uint16_t code);

}  // namespace throwcal
