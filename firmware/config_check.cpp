// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/config_check.h"

#include "capture/quotation.h"
#include "firmware/cameras.h"

namespace throwcal {
namespace {

std::string cameras(const Config& config) {
  std::string out = std::to_string(config.rig.cameras.size()) + " cameras\n";
  for (std::size_t i = 0; i < config.rig.cameras.size(); ++i) {
    const CameraDescription& camera = config.rig.cameras[i];
    out += "  " + camera.name + ": " + std::to_string(camera.model.width_px) + "x" +
           std::to_string(camera.model.height_px) + ", " +
           (camera.model.lens == Lens::kb4 ? "kb4" : "radtan") + ", " +
           printable(source_of(config, i), 200) + "\n";
  }
  return out;
}

std::string physics(const RigDescription& rig) {
  return "ball " + number_text(1e3 * rig.ball.diameter_m) + " mm, drag " +
         (rig.ball.estimate_drag ? "estimated" : number_text(rig.ball.drag_per_m) + " /m") +
         "; gravity " + number_text(rig.gravity_mps2) + " m/s^2; target " +
         number_text(1e3 * rig.target.position_m) + " mm, " +
         number_text(1e3 * rig.target.rotation_rad) + " mrad; clocks' offsets " +
         (rig.estimate_offsets ? "estimated" : "none") + "\n";
}

std::string button(const ButtonSettings& settings) {
  std::string out;
  for (const std::uint16_t key : settings.evdev.keys)
    out += (out.empty() ? "" : ", ") + name_of_key(key);
  if (!settings.evdev.device.empty())
    out += " of " + printable(settings.evdev.device.string(), 200);
  if (settings.gpio) out += (out.empty() ? "" : ", ") + to_string(*settings.gpio);
  return "button: " + (out.empty() ? "none" : out);
}

std::string light(const LightSettings& settings) {
  std::string out = settings.led;
  if (settings.gpio) out += (out.empty() ? "" : ", ") + to_string(*settings.gpio);
  if (!settings.beeper.empty())
    out += (out.empty() ? "" : ", ") + printable(settings.beeper.string(), 200);
  return "light: " + (out.empty() ? "none" : out);
}

std::string place(const ListenAddress& address) {
  return printable(address.host, 200) + ":" + std::to_string(address.port);
}

std::string can(const std::optional<CanSettings>& settings) {
  if (!settings) return "CAN: none\n";
  return "CAN: " + printable(settings->interface, 200) + ", unit " +
         std::to_string(settings->unit) +
         (settings->fd ? ", documents in FD frames\n" : ", classic frames\n");
}

std::string files(const Config& config, const std::filesystem::path& state_dir) {
  return "state folder " + printable(state_dir.string(), 200) + "; token in " +
         printable(config.token_file.value_or(state_dir / "token").string(), 200) + "\n";
}

}  // namespace

std::string summary(const Config& config, const std::filesystem::path& state_dir) {
  return cameras(config) + physics(config.rig) + "TCP " + place(config.listen) + "; HTTP " +
         (config.http.listen ? place(*config.http.listen) : "off") + "\n" + can(config.can) +
         files(config, state_dir) + button(config.button) + "; " + light(config.light) + "\n";
}

}  // namespace throwcal
