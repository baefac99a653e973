// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <cstdint>
#include <opencv2/core.hpp>

namespace throwcal {

/// What each pixel of one camera shows when nothing moves, and how noisy it is. Follows slow
/// changes of light; what differs from it (a ball, a hand) is all but not learnt.
class Background {
 public:
  Background(int width_px, int height_px, double threshold_sigmas);

  /// Marks in `changed` (CV_8U, 255 or 0) the pixels of a grey picture (CV_8U) that differ from the
  /// background by more than their own noise explains, then learns from the picture. False while
  /// the background is being learnt: at first, and again after most of the picture changed at once.
  bool compare_and_learn(const cv::Mat& grey, cv::Mat& changed);

  /// Absolute difference of a region of a picture to the background, CV_8U, into `out` (allocated).
  void difference(const cv::Mat& grey, const cv::Rect& region, cv::Mat& out) const;

  double grey(int x, int y) const {
    return mean_.at<std::int16_t>(y, x) / static_cast<double>(unit);
  }
  /// Standard deviation of a pixel's noise, grey levels.
  double sigma_grey(int x, int y) const;

 private:
  static constexpr int unit = 128;  ///< steps in a grey level: 255 * 128 fits 16 bits
  void learn_from_scratch(const cv::Mat& grey);
  void learn(const cv::Mat& grey, const cv::Mat& changed);

  double threshold_sigmas_;
  cv::Mat mean_;       ///< CV_16S, grey * unit
  cv::Mat deviation_;  ///< CV_16S, mean absolute difference from the mean * unit
  cv::Mat threshold_;  ///< CV_16S, grey * unit
  int learnt_frames_ = 0;
  int turn_ = 0;  ///< which rows learn next
};

}  // namespace throwcal
