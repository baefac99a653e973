// SPDX-License-Identifier: BSD-3-Clause
#include "capture/blobs.h"

#include <algorithm>
#include <cstring>

namespace throwcal {
namespace {

constexpr int bridged_px = 2;  ///< steps from one marked pixel to the next that still joins it

/// First marked column from `x` on, or `width`; eight at a time where nothing is marked.
int next_marked(const std::uint8_t* row, int x, int width) {
  for (; x + 8 <= width; x += 8) {
    std::uint64_t eight;
    std::memcpy(&eight, row + x, 8);
    if (eight) break;
  }
  while (x < width && !row[x]) ++x;
  return x;
}

}  // namespace

const std::vector<Blob>& BlobFinder::find(const cv::Mat& marked, int min_area_px) {
  runs_.clear();
  row_start_.assign(1, 0);
  for (int y = 0; y < marked.rows; ++y) {
    add_runs(marked.ptr(y), y, marked.cols);
    row_start_.push_back(runs_.size());
    const auto row = static_cast<std::size_t>(y);
    for (std::size_t up = 1; up <= bridged_px && up <= row; ++up)
      join_rows(row_start_[row - up], row_start_[row - up + 1], row_start_[row],
                row_start_[row + 1]);
  }
  blobs_.clear();
  blob_of_run_.assign(runs_.size(), -1);
  for (std::size_t i = 0; i < runs_.size(); ++i) {
    int& blob = blob_of_run_[static_cast<std::size_t>(root(static_cast<int>(i)))];
    if (blob < 0) {
      blob = static_cast<int>(blobs_.size());
      blobs_.push_back({});
    }
    add_to_blob(runs_[i], blobs_[static_cast<std::size_t>(blob)]);
  }
  std::erase_if(blobs_, [&](const Blob& blob) { return blob.area_px < min_area_px; });
  for (Blob& blob : blobs_) {
    blob.centroid_px /= blob.area_px;
    blob.spread_px2 =
        blob.spread_px2 / blob.area_px - blob.centroid_px * blob.centroid_px.transpose();
    const Eigen::Vector2d corner(blob.box.x, blob.box.y);  // sums were taken from there
    blob.centroid_px += corner;
  }
  return blobs_;
}

void BlobFinder::add_runs(const std::uint8_t* row, int y, int width) {
  const std::size_t first_of_row = runs_.size();
  for (int x = next_marked(row, 0, width); x < width; x = next_marked(row, x, width)) {
    const int first = x;
    while (x < width && row[x]) ++x;
    if (runs_.size() > first_of_row && first - runs_.back().last <= bridged_px) {
      runs_.back().last = x - 1;
      runs_.back().area += x - first;
    } else {
      runs_.push_back({y, first, x - 1, x - first, static_cast<int>(runs_.size())});
    }
  }
}

void BlobFinder::join_rows(std::size_t above, std::size_t above_end, std::size_t row,
                           std::size_t row_end) {
  while (above < above_end && row < row_end) {
    const Run &a = runs_[above], &b = runs_[row];
    if (a.last + bridged_px < b.first) {
      ++above;
    } else if (b.last + bridged_px < a.first) {
      ++row;
    } else {
      const int low = root(static_cast<int>(above)), high = root(static_cast<int>(row));
      runs_[static_cast<std::size_t>(std::max(low, high))].parent = std::min(low, high);
      a.last < b.last ? ++above : ++row;
    }
  }
}

int BlobFinder::root(int run) {
  const auto parent = [this](int i) -> int& { return runs_[static_cast<std::size_t>(i)].parent; };
  while (parent(run) != run) run = parent(run) = parent(parent(run));
  return run;
}

/// Moments are summed about the box's top-left corner as it grows; the first run fixes the row, so
/// only columns can shift.
void BlobFinder::add_to_blob(const Run& run, Blob& blob) {
  const cv::Rect box(run.first, run.y, run.last - run.first + 1, 1);
  if (blob.area_px == 0) {
    blob.box = box;
  } else {
    const cv::Rect grown = blob.box | box;
    const Eigen::Vector2d shift(blob.box.x - grown.x, blob.box.y - grown.y);
    blob.spread_px2 += blob.centroid_px * shift.transpose() + shift * blob.centroid_px.transpose() +
                       blob.area_px * shift * shift.transpose();
    blob.centroid_px += blob.area_px * shift;
    blob.box = grown;
  }
  const double n = run.area, length = run.last - run.first + 1;
  const Eigen::Vector2d middle(0.5 * (run.first + run.last) - blob.box.x, run.y - blob.box.y);
  blob.area_px += run.area;
  blob.centroid_px += n * middle;
  blob.spread_px2 += n * middle * middle.transpose();
  blob.spread_px2(0, 0) += n * (length * length - 1) / 12;
}

}  // namespace throwcal
