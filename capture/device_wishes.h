// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <optional>
#include <string>
#include <vector>

namespace throwcal {

/// How a camera makes its pictures; nothing where it is not said, or cannot be told. Gain and focus
/// are numbers of the camera's own.
struct PictureNumbers {
  std::optional<double> exposure_s, gain, focus, white_balance_k;
};

/// How it is to make them. What is not said is held as the camera has it, or its automatics have
/// found it after a second.
struct PictureWishes : PictureNumbers {
  bool automatic = false;  ///< leave the camera's automatics on
};

/// How it makes them, as read back from it; no number for what an automatic changes.
struct PictureSettings : PictureNumbers {
  std::vector<std::string> automatic;  ///< what the camera still changes by itself: "exposure"
  int set_back = 0;                    ///< times that another program had changed one of them
};

/// What is wanted of a camera beside its picture's size.
struct DeviceWishes {
  double frames_per_s = 0.0;    ///< 0: as the driver is set
  std::string fourcc;           ///< "YUYV": this one and no other; empty: the cheapest that serves
  std::string input, standard;  ///< of an analog card: "Composite 0", "PAL"; empty: as it is set
  std::string model, serial;    ///< that the camera must be of; empty: any
  PictureWishes picture;
};

}  // namespace throwcal
