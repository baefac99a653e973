// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <filesystem>
#include <optional>
#include <string>

namespace throwcal {

/// A device on a USB bus, as the kernel tells of it in sysfs.
class UsbDevice {
 public:
  explicit UsbDevice(std::filesystem::path folder) : folder_(std::move(folder)) {}

  /// One of its files ("product", "serial", "speed"); empty where it does not tell that.
  std::string text(const std::string& name) const;
  /// Whose bandwidth it shares: "USB bus 1", or below an xHCI, which serves each port by itself,
  /// "USB bus 1, port 3".
  std::string segment() const;
  double speed_mbps() const;  ///< of its link; 0 if unknown

 private:
  std::filesystem::path folder_;  ///< .../usb1/1-3/1-3.2
};

/// The USB device behind a /dev/videoN or a link to it; nothing where it is not on a USB bus.
std::optional<UsbDevice> usb_device_of(const std::filesystem::path& device,
                                       const std::filesystem::path& sysfs = "/sys");

}  // namespace throwcal
