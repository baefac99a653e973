// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <string>
#include <vector>

namespace throwcal {

/// What a camera's pictures need of the USB they come through.
struct UsbStream {
  std::string camera;            ///< its name
  std::string segment;           ///< UsbDevice::segment()
  double link_mbps = 0.0;        ///< 480: high speed
  double megabytes_per_s = 0.0;  ///< uncompressed pictures; 0: compressed, so nobody knows
};

/// Periodic transfers may have four fifths of a high-speed link (USB 2.0, 5.6.4); above it, a byte
/// is ten bits on the wire.
double usb_capacity_mb_per_s(double link_mbps);

/// What helps where a bus has no room.
inline constexpr const char* usb_remedy =
    "another port of the box (not of the same hub), pixel_format = \"MJPG\", fewer frames_per_s or "
    "smaller pictures";

/// A sentence for each bus on which more is wanted than it carries, with the sum and a remedy.
std::vector<std::string> usb_overloads(const std::vector<UsbStream>& streams);

}  // namespace throwcal
