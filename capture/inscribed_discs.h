// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

namespace throwcal {

/// A disc that fits into a marked region and touches its border, pixels.
struct InscribedDisc {
  Eigen::Vector2d centre_px = Eigen::Vector2d::Zero();
  double radius_px = 0.0;
  double free_share = 0.0;  ///< of its rim: how much has nothing marked outside
};

/// Finds the round ends of a marked region: a ball that touches a hand, not the arm below it. Keeps
/// its memory.
class InscribedDiscs {
 public:
  /// Takes the memory for a region of so many pixels now.
  void reserve(std::size_t pixels);
  /// Discs of at least `min_radius_px` whose rim is mostly free, the freest first. Valid until the
  /// next call. `marked`: CV_8U, not zero is marked.
  const std::vector<InscribedDisc>& find(const cv::Mat& marked, double min_radius_px);

 private:
  void measure_distances(const cv::Mat& marked);
  double distance_px(int x, int y) const;
  double free_share(const cv::Mat& marked, const InscribedDisc& disc) const;

  int width_ = 0, height_ = 0;
  std::vector<std::int32_t> distances_;  ///< to what is not marked, in fifths of a pixel
  std::vector<InscribedDisc> peaks_, discs_;
};

}  // namespace throwcal
