// SPDX-License-Identifier: BSD-3-Clause
#include "capture/background.h"

#include <algorithm>
#include <cstdlib>

namespace throwcal {
namespace {

using Fixed = std::int16_t;

constexpr int first_frames = 20;               ///< learnt from scratch
constexpr int row_turns = 4;                   ///< each frame, every fourth row learns
constexpr int still_shift = 3;                 ///< weight 2^-3 a turn: a time constant of 32 frames
constexpr int moving_shift = 7;                ///< of 512 frames, so that a thing put down fades in
constexpr int deviation_shift = 4;             ///< of 64 frames
constexpr double min_sigma_grey = 0.8;         ///< rounding, and the background's own noise
constexpr double sigma_by_deviation = 1.2533;  ///< of a normal distribution: sqrt(pi / 2)
constexpr double new_scene_fraction = 0.4;
constexpr int block = 32;  ///< constant counts are what the compiler turns into vector instructions

inline Fixed distance(std::uint8_t grey, Fixed mean) {
  const auto difference = static_cast<Fixed>(static_cast<Fixed>(grey << 7) - mean);
  return difference < 0 ? static_cast<Fixed>(-difference) : difference;
}

int mark_row(const std::uint8_t* __restrict grey, const Fixed* __restrict mean,
             const Fixed* __restrict threshold, std::uint8_t* __restrict changed, int width) {
  int x = 0, count = 0;
  for (; x + block <= width; x += block) {
    std::uint8_t any = 0;
    for (int i = 0; i < block; ++i) {
      const bool is_changed = distance(grey[x + i], mean[x + i]) > threshold[x + i];
      changed[x + i] = is_changed ? 255 : 0;
      any |= changed[x + i];
    }
    if (any)
      for (int i = 0; i < block; ++i) count += changed[x + i] & 1;
  }
  for (; x < width; ++x) {
    changed[x] = distance(grey[x], mean[x]) > threshold[x] ? 255 : 0;
    count += changed[x] & 1;
  }
  return count;
}

/// A step of 2^-shift, rounded to nearest: rounded down, the mean would creep.
inline Fixed step(int difference, int shift) {
  return static_cast<Fixed>((difference + (1 << (shift - 1))) >> shift);
}

struct Pixel {
  Fixed mean, deviation, threshold;
};

inline Pixel learnt(std::uint8_t grey, std::uint8_t changed, Fixed mean, Fixed deviation,
                    Fixed gain, Fixed floor) {
  const auto difference = static_cast<Fixed>(static_cast<Fixed>(grey << 7) - mean);
  const Fixed size = difference < 0 ? static_cast<Fixed>(-difference) : difference;
  const auto more = static_cast<Fixed>(size - deviation);
  const Fixed mean_step = changed ? step(difference, moving_shift) : step(difference, still_shift);
  const Fixed deviation_step = changed ? step(more, moving_shift) : step(more, deviation_shift);
  const auto new_deviation = static_cast<Fixed>(deviation + deviation_step);
  // gain is sixteenths; 32 grey levels of deviation and more saturate.
  const auto wide = static_cast<Fixed>(std::min<Fixed>(new_deviation, 4000) >> 4);
  const auto threshold = static_cast<Fixed>(wide * gain);
  return {static_cast<Fixed>(mean + mean_step), new_deviation, std::max(threshold, floor)};
}

}  // namespace

Background::Background(int width_px, int height_px, double threshold_sigmas)
    : threshold_sigmas_(threshold_sigmas),
      mean_(height_px, width_px, CV_16S, cv::Scalar(0)),
      deviation_(height_px, width_px, CV_16S, cv::Scalar(0)),
      threshold_(height_px, width_px, CV_16S, cv::Scalar(0)) {}

double Background::sigma_grey(int x, int y) const {
  return std::max(min_sigma_grey, sigma_by_deviation / unit * deviation_.at<Fixed>(y, x));
}

bool Background::compare_and_learn(const cv::Mat& grey, cv::Mat& changed) {
  if (learnt_frames_ < first_frames) {
    learn_from_scratch(grey);
    return false;
  }
  int count = 0;
  for (int y = 0; y < grey.rows; ++y)
    count += mark_row(grey.ptr(y), mean_.ptr<Fixed>(y), threshold_.ptr<Fixed>(y), changed.ptr(y),
                      grey.cols);
  if (count > new_scene_fraction * static_cast<double>(grey.total())) {
    learnt_frames_ = 0;
    return false;
  }
  learn(grey, changed);
  return true;
}

void Background::difference(const cv::Mat& grey, const cv::Rect& region, cv::Mat& out) const {
  for (int y = 0; y < region.height; ++y)
    for (int x = 0; x < region.width; ++x)
      out.at<std::uint8_t>(y, x) =
          static_cast<std::uint8_t>(distance(grey.at<std::uint8_t>(region.y + y, region.x + x),
                                             mean_.at<Fixed>(region.y + y, region.x + x)) /
                                    unit);
}

void Background::learn_from_scratch(const cv::Mat& grey) {
  const int n = learnt_frames_++;
  if (n == 0) deviation_.setTo(static_cast<double>(unit));
  for (int y = 0; y < grey.rows; ++y) {
    const std::uint8_t* pixel = grey.ptr(y);
    Fixed *mean = mean_.ptr<Fixed>(y), *deviation = deviation_.ptr<Fixed>(y);
    for (int x = 0; x < grey.cols; ++x) {
      const int difference = pixel[x] * unit - mean[x];
      if (n)
        deviation[x] =
            static_cast<Fixed>(deviation[x] + (std::abs(difference) - deviation[x]) / (n + 1));
      mean[x] = static_cast<Fixed>(mean[x] + difference / (n + 1));
    }
  }
  if (learnt_frames_ < first_frames) return;
  for (int y = 0; y < grey.rows; ++y)
    for (int x = 0; x < grey.cols; ++x)
      threshold_.at<Fixed>(y, x) =
          static_cast<Fixed>(std::min(32000.0, unit * threshold_sigmas_ * sigma_grey(x, y)));
}

void Background::learn(const cv::Mat& grey, const cv::Mat& changed) {
  const auto gain =
      static_cast<Fixed>(std::min(120.0, 16 * sigma_by_deviation * threshold_sigmas_));
  const auto floor = static_cast<Fixed>(unit * threshold_sigmas_ * min_sigma_grey);
  turn_ = (turn_ + 1) % row_turns;
  for (int y = turn_; y < grey.rows; y += row_turns) {
    const std::uint8_t* __restrict pixel = grey.ptr(y), * __restrict mark = changed.ptr(y);
    Fixed* __restrict mean = mean_.ptr<Fixed>(y);
    Fixed* __restrict deviation = deviation_.ptr<Fixed>(y);
    Fixed* __restrict threshold = threshold_.ptr<Fixed>(y);
    const auto learn_at = [&](int x) {
      const Pixel p = learnt(pixel[x], mark[x], mean[x], deviation[x], gain, floor);
      mean[x] = p.mean;
      deviation[x] = p.deviation;
      threshold[x] = p.threshold;
    };
    int x = 0;
    for (; x + block <= grey.cols; x += block)
      for (int i = 0; i < block; ++i) learn_at(x + i);
    for (; x < grey.cols; ++x) learn_at(x);
  }
}

}  // namespace throwcal
