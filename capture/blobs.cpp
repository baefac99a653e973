// SPDX-License-Identifier: BSD-3-Clause
#include "capture/blobs.h"

#include <algorithm>
#include <array>
#include <utility>

namespace throwcal {
namespace {

constexpr int bridged_px = 2;  ///< steps from one marked pixel to the next that still joins it

}  // namespace

void BlobFinder::reserve(std::size_t runs) {
  runs_.reserve(runs);
  blob_of_run_.reserve(runs);
  blobs_.reserve(runs / 4);
}

const std::vector<Blob>& BlobFinder::find(const cv::Mat& marked, int min_area_px) {
  mask_runs_.clear();
  for (int y = 0; y < marked.rows; ++y) {
    const std::uint8_t* row = marked.ptr(y);
    for (int x = 0; x < marked.cols; ++x) {
      if (!row[x]) continue;
      const int first = x;
      while (x + 1 < marked.cols && row[x + 1]) ++x;
      mask_runs_.push_back({y, first, x});
    }
  }
  return find(mask_runs_, min_area_px);
}

const std::vector<Blob>& BlobFinder::find(std::span<const PixelRun> marked, int min_area_px) {
  runs_.clear();
  for (const PixelRun& run : marked) {
    const int area = run.last - run.first + 1;
    if (!runs_.empty() && runs_.back().y == run.y && run.first - runs_.back().last <= bridged_px) {
      runs_.back().last = run.last;
      runs_.back().area += area;
    } else {
      runs_.push_back({run.y, run.first, run.last, area, static_cast<int>(runs_.size())});
    }
  }
  // Rows above a run, as far as is bridged: their runs begin where these indices say.
  std::size_t row = 0, end = 0;
  std::array<std::pair<std::size_t, std::size_t>, bridged_px> above{};
  for (; row < runs_.size(); row = end) {
    end = row;
    while (end < runs_.size() && runs_[end].y == runs_[row].y) ++end;
    for (const auto& [first, last] : above)
      if (first < last && runs_[row].y - runs_[first].y <= bridged_px)
        join_rows(first, last, row, end);
    std::rotate(above.begin(), above.end() - 1, above.end());
    above.front() = {row, end};
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
