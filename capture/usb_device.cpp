// SPDX-License-Identifier: BSD-3-Clause
#include "capture/usb_device.h"

#include <cstdlib>
#include <fstream>

namespace throwcal {
namespace {

std::string line_of(const std::filesystem::path& file) {
  std::ifstream in(file);
  std::string line;
  std::getline(in, line);
  while (!line.empty() && line.back() == ' ') line.pop_back();
  return line;
}

}  // namespace

std::string UsbDevice::text(const std::string& name) const { return line_of(folder_ / name); }

double UsbDevice::speed_mbps() const { return std::atof(text("speed").c_str()); }

std::string UsbDevice::segment() const {
  const std::string bus = "USB bus " + text("busnum");
  const std::string path = text("devpath");  // "3.2": by port 3, then port 2 of a hub there
  for (auto hub = folder_; hub.has_relative_path(); hub = hub.parent_path())
    if (hub.filename() == "usb" + text("busnum") && line_of(hub / "product").starts_with("xHCI"))
      return bus + ", port " + path.substr(0, path.find('.'));
  return bus;
}

std::optional<UsbDevice> usb_device_of(const std::filesystem::path& device,
                                       const std::filesystem::path& sysfs) {
  std::error_code error;
  const auto node = std::filesystem::canonical(device, error).filename();
  if (error) return std::nullopt;
  const auto interface =
      std::filesystem::canonical(sysfs / "class/video4linux" / node / "device", error);
  if (error) return std::nullopt;
  for (auto folder = interface; folder.has_relative_path(); folder = folder.parent_path())
    if (std::filesystem::exists(folder / "idVendor", error)) return UsbDevice(folder);
  return std::nullopt;
}

}  // namespace throwcal
