// SPDX-License-Identifier: BSD-3-Clause
#include "capture/live_camera.h"

#include <cstdio>

namespace throwcal {

std::string mode_text(const V4l2Format& format) {
  char rate[32];
  std::snprintf(rate, sizeof rate, " at %.4g/s", format.frames_per_s);
  return size_text(static_cast<std::uint32_t>(format.width_px),
                   static_cast<std::uint32_t>(format.height_px)) +
         ' ' + fourcc_text(format.fourcc) + (format.frames_per_s > 0 ? rate : "");
}

void check_identity(const std::string& place, const CameraIdentity& found,
                    const CameraSource& source, const std::optional<CameraIdentity>& accepted) {
  CameraIdentity expected = accepted.value_or(CameraIdentity{});
  if (!source.device.model.empty()) expected.model = source.device.model;
  if (!source.device.serial.empty()) expected.serial = source.device.serial;
  // Twins without serial numbers are told apart by their ports.
  const bool is_moved = accepted && accepted->serial.empty() && accepted->port != found.port;
  if ((expected.model.empty() || expected.model == found.model) &&
      (expected.serial.empty() || expected.serial == found.serial) && !is_moved)
    return;
  std::string whose;
  for (const NamedSerial& other : source.others)
    if (other.serial == found.serial && !found.serial.empty())
      whose = ", which the rig file calls \"" + other.camera + "\": the cables are swapped";
  const auto port = [&](const std::string& text) { return is_moved ? " at " + text : ""; };
  throw WrongCamera(place + ": here is " + description(found) + port(found.port) + whose +
                    "; expected " + description(expected) + port(expected.port));
}

bool may_pass(const std::runtime_error& error) {
  if (dynamic_cast<const WrongCamera*>(&error)) return true;
  const auto* device = dynamic_cast<const DeviceError*>(&error);
  return device && (device->is_gone() || device->is_busy());
}

std::string open_error(const std::string& place, const std::runtime_error& error, bool was_here) {
  const auto* device = dynamic_cast<const DeviceError*>(&error);
  if (!device || !device->is_gone()) return error.what();
  return place + (was_here ? ": was unplugged" : ": is not plugged in");
}

Camera::Format widest_format(const CameraSource& source) {
  return {source.model.width_px, source.model.height_px,
          source.colour ? PixelFormat::bgr : PixelFormat::grey, source.device.frames_per_s};
}

}  // namespace throwcal
