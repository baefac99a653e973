// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <string>

namespace throwcal {

/// [can] of the rig file.
struct CanSettings {
  std::string interface;  ///< "can0"
  int unit = 0;           ///< which 32 identifiers: 0 to 11
  bool fd = false;        ///< documents in CAN FD frames
};

}  // namespace throwcal
