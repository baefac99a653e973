// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <opencv2/core.hpp>
#include <optional>
#include <span>
#include <vector>

#include "capture/background.h"
#include "capture/ball_outline.h"
#include "capture/blobs.h"
#include "capture/expected_balls.h"
#include "capture/inscribed_discs.h"
#include "capture/pixel_run.h"

namespace throwcal {

/// Where a fit begins, and why.
struct BallStart {
  BallOutline outline;
  double promise = 0.0;                 ///< the larger, the sooner it is tried
  const KnownBall* expected = nullptr;  ///< the ball that should be there
};

/// From the pixels that changed to where balls may be: round blobs and streaks, round ends of a
/// blob (a ball that still touches the hand), circles that the picture's edge cuts. Keeps its
/// memory.
class BallStarts {
 public:
  BallStarts(int width_px, int height_px, double min_radius_px, double max_radius_px);

  /// The most promising first: what is expected, then what is round. `changed` are the pixels of
  /// `grey` that differ from `background`. Valid until the next call; points into `expected`.
  const std::vector<BallStart>& find(const cv::Mat& grey, const Background& background,
                                     std::span<const PixelRun> changed,
                                     std::span<const KnownBall> expected);

 private:
  bool is_cut(const Blob& blob) const;
  bool is_possible(double radius_px) const;
  std::optional<BallOutline> outline_of(const Blob& blob) const;
  std::optional<BallOutline> outline_of_cut(const cv::Mat& marked, const Blob& blob) const;
  void add_round_ends(const cv::Mat& marked, const Blob& blob);

  double min_radius_px_, max_radius_px_;
  BlobFinder blob_finder_;
  InscribedDiscs inscribed_discs_;
  cv::Mat mask_;
  std::vector<BallStart> starts_;
};

}  // namespace throwcal
