// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <array>
#include <opencv2/core.hpp>
#include <optional>

#include "capture/colour.h"
#include "capture/frame.h"

namespace throwcal {

/// The one-channel picture in which a ball is looked for. Without a ball's colour that is the luma.
/// With one it is the linear mixture of luma and chroma in which that colour stands out most from a
/// world whose greys differ much and whose colours differ little (Fisher's discriminant); linear,
/// so that a pixel half covered still shows half of it.
class BallSignal {
 public:
  explicit BallSignal(std::optional<Colour> ball_colour);

  /// CV_8U, valid until the next call and as long as the frame's pixels are.
  cv::Mat of(const ImageView& image);

 private:
  /// signal = offset + weight . (Y, U - 128, V - 128), BT.601 of full range, as cameras give it.
  double offset_ = 0.0;
  std::array<double, 3> weight_{1.0, 0.0, 0.0};
  bool has_colour_ = false;
  cv::Mat signal_;
};

}  // namespace throwcal
