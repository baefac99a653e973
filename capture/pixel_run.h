// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace throwcal {

/// Pixels side by side in one row of a picture, both ends included.
struct PixelRun {
  int y = 0, first = 0, last = 0;
};

}  // namespace throwcal
