// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <cstdint>
#include <vector>

#include "capture/frame.h"

namespace throwcal {

/// Which part of a picture: every `step_px`-th pixel, in both axes, from (x_px, y_px) on.
struct CropArea {
  int x_px = 0, y_px = 0;
  int width = 0, height = 0;  ///< of the crop, in its own pixels
  int step_px = 1;
};

/// Its brightness, one byte a pixel, rows from the top.
struct PictureCrop {
  CropArea area;
  HostTime time{};
  std::vector<std::uint8_t> pixels;
};

/// The whole picture, thinned out until it is at most so wide.
CropArea whole_picture(const ImageView& image, int max_width);

/// The square around a ball, with as much of its surroundings, at most `max_side` wide and high; it
/// lies within the picture.
CropArea around(const ImageView& image, double u_px, double v_px, double radius_px, int max_side);

/// Writes area.width x area.height bytes. The area must lie within the picture.
void copy_brightness(const ImageView& image, const CropArea& area, std::uint8_t* out);
PictureCrop crop(const Frame& frame, const CropArea& area);

}  // namespace throwcal
