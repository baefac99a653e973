// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/camera_changes.h"

#include <algorithm>

namespace throwcal {
namespace {

using Json = nlohmann::ordered_json;

CameraIdentity read(const Json& device) {
  return {device.value("port", ""), device.value("model", ""), device.value("serial", ""),
          device.value("mode", "")};
}

/// "640x480" of "640x480 YUYV at 30/s".
std::string size_of(const CameraIdentity& device) {
  return device.mode.substr(0, device.mode.find(' '));
}

/// The same camera, as far as can be told: one without a serial number is known by its port, and so
/// is one of several with the same.
bool is_same(const Json& document, const CameraIdentity& a, const CameraIdentity& b) {
  if (a.model != b.model || a.serial != b.serial) return false;
  const auto has_it = [&](const Json& camera) {
    return camera.contains("device") && read(camera.at("device")).serial == a.serial;
  };
  const bool is_unique =
      !a.serial.empty() && std::ranges::count_if(document.at("cameras"), has_it) < 2;
  return is_unique || a.port == b.port;
}

/// The camera of the document whose device this is; a camera without a serial number could be any.
std::string name_in(const Json& document, const CameraIdentity& device) {
  for (const Json& camera : document.at("cameras"))
    if (!device.serial.empty() && camera.contains("device") &&
        is_same(document, read(camera.at("device")), device))
      return camera.at("name").get<std::string>();
  return {};
}

}  // namespace

Json devices_of(const std::vector<CameraStats>& cameras, bool only_working) {
  Json out = Json::object();
  for (const CameraStats& camera : cameras)
    if (const CameraIdentity& is = camera.identity;
        !is.port.empty() && !(only_working && !camera.error.empty()))
      out[camera.name] = {
          {"port", is.port}, {"model", is.model}, {"serial", is.serial}, {"mode", is.mode}};
  return out;
}

void add_devices(Json& document, const Json& devices) {
  for (Json& camera : document.at("cameras"))
    if (const auto device = devices.find(camera.at("name").get<std::string>());
        device != devices.end())
      camera["device"] = *device;
}

std::vector<std::string> camera_changes(const Json& document, const Json& devices_now) {
  std::vector<std::string> out;
  for (const Json& camera : document.at("cameras")) {
    const std::string name = camera.at("name");
    if (!camera.contains("device") || !devices_now.contains(name)) continue;
    const CameraIdentity was = read(camera.at("device")), is = read(devices_now.at(name));
    const std::string place = "camera \"" + name + "\"";
    if (is_same(document, was, is)) {
      // Rate and pixel format leave a pixel where it is.
      if (!is.mode.empty() && size_of(was) != size_of(is))
        out.push_back(place + " gave " + was.mode + ", now " + is.mode);
      continue;
    }
    const std::string whose = name_in(document, is);
    out.push_back(place + " was " + description(was) + " at " + was.port + ", now it is " +
                  description(is) + " at " + is.port +
                  (whose.empty() ? "" : ", which was \"" + whose + "\": cables are swapped"));
  }
  return out;
}

}  // namespace throwcal
