// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <opencv2/core.hpp>
#include <span>
#include <string>

#include "capture/frame.h"
#include "estimator/observation.h"

namespace throwcal {

/// A picture for a person to look at: grey, at most 640 pixels wide, with a ring round each ball.
struct Preview {
  std::string jpeg;
  /// Where the rings are, in this picture's pixels: "u,v u,v"; empty: no ball was seen.
  std::string balls;
};

/// The luma of a frame, made small, without any of the frame's own memory: its lease may go.
cv::Mat small_luma(const ImageView& image);

/// `scale`: of `luma` to the frame, in whose pixels the sightings are.
Preview make_preview(cv::Mat luma, double scale, std::span<const BallSighting> sightings);

}  // namespace throwcal
