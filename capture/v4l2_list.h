// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "capture/v4l2_controls.h"

namespace throwcal {

/// A size that a camera offers in one pixel format.
struct V4l2Size {
  std::string text;  ///< "640x480", or "64x64 to 1920x1080"
  std::vector<double> frames_per_s;
};

struct V4l2Offer {
  std::string fourcc;
  bool is_read = false;  ///< throwcal can read this format
  std::vector<V4l2Size> sizes;
};

/// A V4L2 camera of this machine, as its driver describes it.
struct V4l2Listing {
  std::string device;   ///< "/dev/video0"
  std::string by_path;  ///< by the port it is plugged into: stays when others come and go; or empty
  std::string card, driver, bus;
  std::string model, serial;  ///< as a rig file names it; a serial may be empty: it has none
  std::vector<V4l2Offer> offers;
  std::vector<std::string> inputs;    ///< of a card with several
  std::vector<V4l2Control> controls;  ///< of its pictures
  std::string problem;                ///< why it cannot be used or asked; empty: nothing is wrong
};

/// All of /dev/video*, in order; what captures no pictures is left out.
std::vector<V4l2Listing> list_v4l2_cameras();

/// The link in `links` that leads to `device`, or empty. Of several the shortest: udev 257 names a
/// USB camera's port twice (-usb-, -usbv2-), and the older, shorter name holds on every Debian.
std::string by_path(const std::filesystem::path& device,
                    const std::filesystem::path& links = "/dev/v4l/by-path");

}  // namespace throwcal
