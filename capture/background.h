// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "capture/pixel_run.h"

namespace throwcal {

/// What each pixel of one camera shows when nothing moves, how noisy it is and how restless (a
/// branch that sways). Follows the light, slowly pixel by pixel and at once where the whole picture
/// becomes brighter or darker; what differs from it (a ball, a hand) is all but not learnt.
class Background {
 public:
  enum class Outcome { learning, compared };

  Background(int width_px, int height_px, double threshold_sigmas);

  /// Finds the pixels of a grey picture (CV_8U) that differ from the background by more than their
  /// own noise and unrest explain, row by row, then learns from the picture. `learning`: nothing
  /// is compared, at first, again after most of the picture changed or shook for long, and where it
  /// is dark or saturated.
  Outcome compare_and_learn(const cv::Mat& grey, std::vector<PixelRun>& changed);

  /// Marks the same pixels of a region in a mask of its size (CV_8U, 255 or 0), before it learns
  /// again.
  void mark(const cv::Mat& grey, const cv::Rect& region, cv::Mat& mask) const;

  double grey(int x, int y) const { return mean_.at<std::int16_t>(y, x) * (1.0 / unit); }
  /// Standard deviation of a pixel's noise, grey levels.
  double sigma_grey(int x, int y) const;
  /// Standard deviation of what moves there, grey levels: 0 where all is still.
  double unrest_grey(int x, int y) const;

  /// That of most pixels: the camera's, without what moves.
  double typical_sigma_grey() const { return typical_sigma_grey_; }

  /// What the last picture was like, beside what moved in it.
  bool is_dark() const { return is_dark_; }            ///< too dark to see anything in
  bool is_saturated() const { return is_saturated_; }  ///< most of it is as bright as can be
  bool is_shaken() const { return is_shaken_; }        ///< changes everywhere, not in places

 private:
  static constexpr int unit = 128;  ///< steps in a grey level: 255 * 128 fits 16 bits
  void learn_from_scratch(const cv::Mat& grey);
  void part_noise_from_unrest();
  void set_bounds(int row);
  double brightness_ratio(const cv::Mat& grey);
  void find_typical_sigma();
  void scale(double ratio);
  void compare(const cv::Mat& grey, std::vector<PixelRun>& changed) const;
  bool is_everywhere(const std::vector<PixelRun>& changed);
  void learn(const cv::Mat& grey);

  double threshold_sigmas_, typical_sigma_grey_ = 1.0;
  cv::Mat mean_;       ///< CV_16S, grey * unit
  cv::Mat deviation_;  ///< CV_16S, mean absolute difference from the mean * unit
  cv::Mat unrest_;     ///< CV_8U, half grey levels by which a restless pixel's bounds are wider
  cv::Mat candidate_, candidate_turns_;  ///< CV_8U: what differs and stays, and for how long
  cv::Mat low_, high_;                   ///< CV_8U: the bounds within which nothing has changed
  std::vector<float> samples_;
  std::vector<int> tiles_;
  int learnt_frames_ = 0, shaken_frames_ = 0;
  unsigned looked_frames_ = 0;
  int turn_ = 0;  ///< which rows learn next
  bool is_dark_ = false, is_saturated_ = false, is_shaken_ = false;
};

}  // namespace throwcal
