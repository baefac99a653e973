// SPDX-License-Identifier: BSD-3-Clause
#include "capture/picture_crop.h"

#include <algorithm>
#include <cmath>

namespace throwcal {
namespace {

/// Of pixel x of a row; NV12's first plane is brightness alone.
std::uint8_t brightness(const std::uint8_t* row, int x, PixelFormat format) {
  if (format == PixelFormat::yuyv) return row[2 * x];
  if (format != PixelFormat::bgr) return row[x];
  const std::uint8_t* bgr = row + 3 * x;
  return static_cast<std::uint8_t>((29 * bgr[0] + 150 * bgr[1] + 77 * bgr[2]) >> 8);
}

}  // namespace

CropArea whole_picture(const ImageView& image, int max_width) {
  const int step = (image.width_px + max_width - 1) / max_width;
  return {0, 0, image.width_px / step, image.height_px / step, step};
}

CropArea around(const ImageView& image, double u_px, double v_px, double radius_px, int max_side) {
  constexpr double surroundings = 2.0, margin_px = 4.0, max_radius_px = 1e4;
  const double radius = std::isfinite(radius_px) ? std::clamp(radius_px, 2.0, max_radius_px) : 2.0;
  const int side = std::min(
      {static_cast<int>(2 * (surroundings * radius + margin_px)), image.width_px, image.height_px});
  const int step = (side + max_side - 1) / max_side;
  const auto start = [&](double centre, int size) {
    const double from = std::isfinite(centre) ? std::clamp(centre, 0.0, size - 1.0) : 0.0;
    return std::clamp(static_cast<int>(from) - side / 2, 0, size - side);
  };
  return {start(u_px, image.width_px), start(v_px, image.height_px), side / step, side / step,
          step};
}

void copy_brightness(const ImageView& image, const CropArea& area, std::uint8_t* out) {
  for (int j = 0; j < area.height; ++j) {
    const std::uint8_t* row =
        image.data + static_cast<std::size_t>(area.y_px + j * area.step_px) * image.stride_bytes;
    for (int i = 0; i < area.width; ++i)
      *out++ = brightness(row, area.x_px + i * area.step_px, image.format);
  }
}

PictureCrop crop(const Frame& frame, const CropArea& area) {
  PictureCrop out{area, frame.row0_mid_exposure, {}};
  out.pixels.resize(static_cast<std::size_t>(area.width) * static_cast<std::size_t>(area.height));
  copy_brightness(frame.image, area, out.pixels.data());
  return out;
}

}  // namespace throwcal
