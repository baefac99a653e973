// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/config_check.h"

#include "capture/quotation.h"
#include "firmware/input_error.h"

namespace throwcal {
namespace {

std::string cameras(const Config& config) {
  std::string out = std::to_string(config.rig.cameras.size()) + " cameras\n";
  for (std::size_t i = 0; i < config.rig.cameras.size(); ++i) {
    const CameraDescription& camera = config.rig.cameras[i];
    const std::string& source = config.inputs[i].source;
    if (source.empty())
      throw InputError("camera \"" + camera.name +
                       "\" has no source; expected source = \"simulated\", \"video:PATH\", "
                       "\"v4l2:DEVICE\" or \"libcamera:ID\"");
    out += "  " + camera.name + ": " + std::to_string(camera.model.width_px) + "x" +
           std::to_string(camera.model.height_px) + ", " +
           (camera.model.lens == Lens::kb4 ? "kb4" : "radtan") + ", " + printable(source, 200) +
           "\n";
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

}  // namespace

std::string summary(const Config& config) {
  return cameras(config) + physics(config.rig) + "TCP " + printable(config.listen.host, 200) + ":" +
         std::to_string(config.listen.port) + "; " + button(config.button) + "; " +
         light(config.light) + "\n";
}

}  // namespace throwcal
