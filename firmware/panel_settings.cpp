// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/panel_settings.h"

#include <libevdev/libevdev.h>

#include <algorithm>
#include <charconv>

#include "firmware/text_file.h"
#include "firmware/toml_table.h"

namespace throwcal {
namespace {

constexpr std::size_t max_keys = 16, longest_name = 64;

/// One that a misspelling leaves unread would silently do nothing.
void refuse_unread(const TomlTable& table) {
  if (const auto unread = table.unread(); !unread.empty()) throw InputError(unread.front());
}

/// In one folder: nothing of it leads out.
bool is_file_name(std::string_view text) {
  return !text.empty() && text.size() <= longest_name && !text.starts_with('.') &&
         text.find('/') == text.npos &&
         std::ranges::all_of(text, [](char c) { return c > ' ' && c <= '~'; });
}

std::optional<std::filesystem::path> device(TomlTable& table, std::string_view key) {
  const auto text = table.text(key);
  if (text && (!text->starts_with("/dev/") || text->size() > 255 || text->find('\0') != text->npos))
    table.reject(key, "the path of an input device, /dev/input/...");
  return text;
}

std::vector<std::uint16_t> read_keys(TomlTable& table) {
  std::vector<std::uint16_t> out;
  const auto names = table.text_or_texts("key").value_or(std::vector<std::string>{});
  for (const std::string& name : names) {
    const int code = libevdev_event_code_from_name(EV_KEY, name.c_str());
    if (code < 0 || code == KEY_RESERVED || names.size() > max_keys)
      table.reject("key",
                   "a key's name in linux/input-event-codes.h like \"KEY_RECORD\", or a "
                   "list of at most 16");
    out.push_back(static_cast<std::uint16_t>(code));
  }
  return out;
}

std::optional<GpioLineSettings> read_gpio(TomlTable& table) {
  const auto text = table.text("gpio");
  auto out = text ? parse_gpio_line(*text) : std::nullopt;
  if (text && !out) table.reject("gpio", "a chip and a line's number like \"gpiochip0:17\"");
  const auto active_low = table.boolean("active_low");
  if (active_low && !out) table.missing("gpio", "it, as active_low is said");
  if (out) out->active_low = active_low.value_or(false);
  return out;
}

std::chrono::milliseconds read_debounce(TomlTable& table) {
  const auto s = table.number("debounce_s", between(0, 0.5, "a number of seconds"));
  return s ? std::chrono::milliseconds(static_cast<int>(1000.0 * *s + 0.5))
           : ButtonTimes{}.debounce;
}

std::string to_toml(const std::optional<GpioLineSettings>& gpio) {
  if (!gpio) return {};
  static constexpr const char* pulls[] = {"", "none", "up", "down"};
  const std::string pull = pulls[static_cast<int>(gpio->pull)];
  return "gpio = \"" + to_string(*gpio) + "\"\n" + (gpio->active_low ? "active_low = true\n" : "") +
         (pull.empty() ? "" : "pull = \"" + pull + "\"\n");
}

}  // namespace

ButtonSettings read_button(TomlTable table) {
  ButtonSettings out;
  out.evdev.keys = read_keys(table);
  out.evdev.device = device(table, "device").value_or("");
  out.evdev.grab = table.boolean("grab").value_or(false);
  if (out.evdev.keys.empty() && (!out.evdev.device.empty() || out.evdev.grab))
    table.missing("key", "the name of a key like \"KEY_RECORD\"");
  out.gpio = read_gpio(table);
  if (const auto pull = table.choice("pull", {"none", "up", "down"})) {
    if (!out.gpio) table.missing("gpio", "it, as pull is said");
    out.gpio->pull = *pull == "up" ? Pull::up : *pull == "down" ? Pull::down : Pull::none;
  }
  out.times.debounce = read_debounce(table);
  if (table.has("debounce_s") && !out.is_there()) table.missing("key", "it or gpio");
  refuse_unread(table);
  return out;
}

LightSettings read_light(TomlTable table) {
  LightSettings out;
  out.led = table.text("led").value_or("");
  if (table.has("led") && !is_file_name(out.led))
    table.reject("led", "the name of one in /sys/class/leds");
  out.gpio = read_gpio(table);
  out.beeper = device(table, "beep").value_or("");
  refuse_unread(table);
  return out;
}

std::string to_toml(const ButtonSettings& button) {
  if (!button.is_there()) return {};
  std::string out = "\n[button]\n";
  for (std::size_t i = 0; i < button.evdev.keys.size(); ++i)
    out += (i ? ", " : "key = [") + quoted(name_of_key(button.evdev.keys[i]));
  if (!button.evdev.keys.empty()) out += "]\n";
  if (!button.evdev.device.empty()) out += "device = " + quoted(button.evdev.device) + "\n";
  if (button.evdev.grab) out += "grab = true\n";
  out += to_toml(button.gpio);
  return out +
         "debounce_s = " + shortest(static_cast<double>(button.times.debounce.count()) / 1000.0) +
         "\n";
}

std::string to_toml(const LightSettings& light) {
  if (!light.is_there()) return {};
  std::string out = "\n[light]\n";
  if (!light.led.empty()) out += "led = " + quoted(light.led) + "\n";
  out += to_toml(light.gpio);
  if (!light.beeper.empty()) out += "beep = " + quoted(light.beeper) + "\n";
  return out;
}

std::optional<GpioLineSettings> parse_gpio_line(std::string_view text) {
  const std::size_t colon = text.find(':');
  if (colon == text.npos || !is_file_name(text.substr(0, colon))) return {};
  GpioLineSettings out{.chip = std::string(text.substr(0, colon))};
  const std::string_view line = text.substr(colon + 1);
  const auto [end, error] = std::from_chars(line.data(), line.data() + line.size(), out.line);
  if (error != std::errc{} || end != line.data() + line.size() || out.line > 65535) return {};
  return out;
}

std::string to_string(const GpioLineSettings& line) {
  return line.chip + ":" + std::to_string(line.line);
}

std::string name_of_key(std::uint16_t code) {
  const char* name = libevdev_event_code_get_name(EV_KEY, code);
  return name ? name : std::to_string(code);
}

}  // namespace throwcal
