// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <filesystem>
#include <string>

namespace throwcal {

/// Which camera this is. A port stays the same when others come and go; model and serial tell
/// whether it is still the same camera that is plugged in there; the mode tells whether its pixels
/// mean the same. Empty: not known (only USB cameras tell a serial, and not all of them).
struct CameraIdentity {
  std::string port;    ///< "usb-0000:00:14.0-2", as the driver names it
  std::string model;   ///< "HD Pro Webcam C920"
  std::string serial;  ///< "3B1AF2EF"
  std::string mode;    ///< "640x480 YUYV at 30/s"

  bool operator==(const CameraIdentity&) const = default;
};

/// Model and serial of the USB device behind a /dev/videoN (or a link to it); nothing in them where
/// it is none.
CameraIdentity usb_identity(const std::filesystem::path& device,
                            const std::filesystem::path& sysfs = "/sys");

/// `"HD Pro Webcam C920", serial 3B1AF2EF`.
std::string description(const CameraIdentity& identity);

}  // namespace throwcal
