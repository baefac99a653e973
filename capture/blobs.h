// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <span>
#include <vector>

#include "capture/pixel_run.h"

namespace throwcal {

/// A group of marked pixels that touch, or nearly so.
struct Blob {
  int area_px = 0;
  cv::Rect box;
  Eigen::Vector2d centroid_px = Eigen::Vector2d::Zero();
  Eigen::Matrix2d spread_px2 = Eigen::Matrix2d::Zero();  ///< second moments about the centroid
};

/// Finds blobs by runs of marked pixels; its memory grows to what the busiest frame needs and
/// stays.
class BlobFinder {
 public:
  /// Takes the memory for so many runs now.
  void reserve(std::size_t runs);
  /// Blobs of at least `min_area_px` in marked pixels, given row by row from left to right. Pixels
  /// with one unmarked between them belong together: what closing would bridge. Valid until the
  /// next call.
  const std::vector<Blob>& find(std::span<const PixelRun> marked, int min_area_px);
  /// The same of a mask (CV_8U; marked is not zero).
  const std::vector<Blob>& find(const cv::Mat& marked, int min_area_px);

 private:
  struct Run {
    int y, first, last;  ///< columns, both marked
    int area;
    int parent;
  };
  void join_rows(std::size_t above, std::size_t above_end, std::size_t row, std::size_t row_end);
  int root(int run);
  void add_to_blob(const Run& run, Blob& blob);

  std::vector<PixelRun> mask_runs_;
  std::vector<Run> runs_;
  std::vector<int> blob_of_run_;
  std::vector<Blob> blobs_;
};

}  // namespace throwcal
