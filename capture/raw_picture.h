// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <cstdint>
#include <opencv2/core.hpp>
#include <span>

#include "capture/frame.h"
#include "capture/v4l2_stream.h"

namespace throwcal {

/// From what a V4L2 driver gives (packed and planar YUV, Bayer, JPEG, interlaced fields) to the
/// pictures that the rest of capture/ reads, in one pass over the pixels. Keeps its memory.
class RawPicture {
 public:
  /// `colour`: keep the chroma where there is any. Interlaced pictures become grey.
  RawPicture(const V4l2Format& format, bool colour);

  /// Of what write() makes; its height is the whole picture's, of fields too.
  PixelFormat format() const { return made_; }
  int height_px() const { return height_px_; }

  /// Writes a picture, tightly packed. False where a JPEG can't be decoded or has another size.
  bool write(std::span<const std::uint8_t> bytes, std::span<std::uint8_t> slot);
  /// One field of a buffer as a whole picture: its own lines where they are, those between the mean
  /// of their neighbours.
  void write_field(std::span<const std::uint8_t> bytes, bool is_bottom,
                   std::span<std::uint8_t> slot);

 private:
  cv::Mat luma(const cv::Mat& raw);

  V4l2Format raw_;
  PixelFormat made_ = PixelFormat::grey;
  int height_px_;
  cv::Mat decoded_, luma_;
};

}  // namespace throwcal
