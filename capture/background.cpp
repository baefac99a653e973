// SPDX-License-Identifier: BSD-3-Clause
#include "capture/background.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>

namespace throwcal {
namespace {

using Fixed = std::int16_t;
using Byte = std::uint8_t;

constexpr int first_frames = 20;    ///< learnt from scratch
constexpr int row_turns = 16;       ///< each frame, every sixteenth row learns
constexpr int still_shift = 3;      ///< weight 2^-3 a turn: a time constant of 128 frames
constexpr int moving_shift = 6;     ///< of 1024 frames, so that a thing put down fades in
constexpr int deviation_shift = 3;  ///< of 128 frames
/// What moved before the first throw is learnt before it: unrest grows and falls faster at first,
/// but mean and deviation are not learnt faster from what is there.
constexpr unsigned young_frames = 180;
constexpr int young_turns = 4, young_shift = 2;
constexpr Fixed young_max_unrest = 60;  ///< a branch's; who walks by is not learnt as fast
/// What differs and stays the same for 128 frames is background: a thing put down, the place where
/// somebody stood while it was learnt.
constexpr Fixed settled_turns = 8, young_settled_turns = 32, settled_unrest = 60;
constexpr double min_sigma_grey = 0.8;         ///< rounding, and the background's own noise
constexpr double sigma_by_deviation = 1.2533;  ///< of a normal distribution: sqrt(pi / 2)
/// Unrest doubles each turn that a pixel is found changed, and falls by a step and a part of itself
/// else: a ball that passes adds next to nothing, a branch that sways is covered within some
/// seconds.
constexpr Fixed unrest_start = 4, unrest_decay = 2, max_unrest = 240;
constexpr int unrest_decay_shift = 5;
constexpr int unrest_by_deviation =
    4;                              ///< steps a grey level of mean absolute difference: twice it
constexpr double max_sigmas = 2.5;  ///< of the typical noise, that a pixel's own may be
constexpr double sigma_by_unrest = 0.5 / 3;  ///< grey levels a step of unrest
constexpr double new_scene_fraction = 0.4;
constexpr int samples_a_side = 24;  ///< of the grid on which the light is measured
constexpr int min_ratio_grey = 12, dark_grey = 10, saturated_grey = 250;
constexpr double light_step = 0.007;    ///< a change of light that is followed at once
constexpr double max_light_step = 2.5;  ///< beyond it is another scene
constexpr int typical_frames = 64;      ///< how often the camera's noise is measured
constexpr int tiles_a_side = 8;
constexpr double shaken_tiles = 0.7, shaken_share = 0.02;
constexpr int max_shaken_frames = 15;  ///< then it is another view: learnt anew
constexpr int block =
    128;  ///< constant counts are what the compiler turns into vector instructions

bool is_changed(Byte grey, Byte low, Byte high) { return grey < low || grey > high; }

/// A step of 2^-shift, rounded to nearest: rounded down, the mean would creep.
inline Fixed step(Fixed difference, int shift) {
  const auto half_steps = static_cast<Fixed>(difference >> (shift - 1));
  return static_cast<Fixed>(static_cast<Fixed>(half_steps + 1) >> 1);
}

struct Bounds {
  Fixed gain;            ///< sixteenths of a deviation
  Fixed floor;           ///< of the threshold
  Fixed most_deviation;  ///< what is more is no noise but unrest
};

inline Fixed threshold(Fixed deviation, Fixed gain, Fixed floor) {
  const auto wide = static_cast<Fixed>(static_cast<Fixed>(deviation >> 4) * gain);
  return wide > floor ? wide : floor;
}

/// The grey levels that are within a threshold and the unrest of the mean, rounded inwards. All
/// sums fit 16 bits, of which a vector holds twice as many as of 32: hence the casts.
inline Byte low_bound(Fixed mean, Fixed wide, Fixed unrest) {
  const auto low = static_cast<Fixed>(static_cast<Fixed>(mean - wide + 127) >> 7);
  const auto lower = static_cast<Fixed>(low - (unrest >> 1));
  return static_cast<Byte>(lower < 0 ? Fixed(0) : lower);
}
inline Byte high_bound(Fixed mean, Fixed wide, Fixed unrest) {
  const auto most = static_cast<Fixed>(32767 - mean);
  const auto high = static_cast<Fixed>(static_cast<Fixed>(mean + (wide < most ? wide : most)) >> 7);
  const auto higher = static_cast<Fixed>(high + (unrest >> 1));
  return static_cast<Byte>(higher > 255 ? Fixed(255) : higher);
}

/// One row of what is learnt of the background.
struct Row {
  Fixed* __restrict mean, * __restrict deviation;
  Byte* __restrict unrest, * __restrict low, * __restrict high;
  Byte* __restrict candidate, * __restrict turns;
};

/// How fast: see the constants.
struct Pace {
  int slower;
  Fixed max_unrest, settled_turns;
};

/// Four cases: noise, of which mean and deviation learn; what the pixel's unrest explains, of which
/// nothing learns; what is new, by which the unrest grows; and what is no longer new, for it has
/// stayed: it becomes the background.
void learn_row(const Byte* grey, const Row row, int width, const Bounds& bounds, const Pace& pace) {
  const Fixed gain = bounds.gain, floor = bounds.floor, most = bounds.most_deviation;
  const Fixed growable = pace.max_unrest, enough_turns = pace.settled_turns;
  const int slow_shift = moving_shift + pace.slower, fast_shift = still_shift + pace.slower,
            wider_shift = deviation_shift + pace.slower;
#pragma omp simd
  for (int x = 0; x < width; ++x) {
    const Fixed seen = grey[x], mean = row.mean[x], deviation = row.deviation[x];
    const Fixed unrest = row.unrest[x], low = row.low[x], high = row.high[x];
    const auto level = static_cast<Fixed>(seen << 7);
    const auto difference = static_cast<Fixed>(level - mean);
    const auto size = static_cast<Fixed>(difference < 0 ? -difference : difference);
    const Fixed wide = threshold(deviation, gain, floor);
    const bool is_off = size > wide;
    const Fixed candidate = row.candidate[x], turns = row.turns[x];
    const auto drift = static_cast<Fixed>(static_cast<Fixed>(seen - candidate) << 7);
    const auto drifted = static_cast<Fixed>(drift < 0 ? -drift : drift);
    const Fixed stayed = drifted > wide ? Fixed(0) : static_cast<Fixed>(turns + 1);
    const Fixed new_turns = is_off ? stayed : Fixed(0);
    const bool is_settled = new_turns >= enough_turns;
    const auto moved = static_cast<Fixed>(
        mean + (is_off ? step(difference, slow_shift) : step(difference, fast_shift)));
    const Fixed new_mean = is_settled ? level : moved;
    const Fixed wider = step(static_cast<Fixed>(size - deviation), wider_shift);
    const auto learnt = static_cast<Fixed>(deviation + (is_off ? Fixed(0) : wider));
    const Fixed new_deviation = learnt < most ? learnt : most;
    const auto grown = static_cast<Fixed>(unrest + unrest_start + unrest);
    const auto decay = static_cast<Fixed>(unrest_decay + (unrest >> unrest_decay_shift));
    const auto calmer = static_cast<Fixed>(unrest > decay ? unrest - decay : 0);
    const Fixed held = is_off ? unrest : calmer;
    const Fixed within = seen > high ? grown : held;
    const Fixed changed = seen < low ? grown : within;
    const Fixed growth = unrest > growable ? unrest : growable;
    const Fixed most_unrest = is_settled ? settled_unrest : growth;
    const Fixed new_unrest = changed < most_unrest ? changed : most_unrest;
    const Fixed new_wide = threshold(new_deviation, gain, floor);
    row.mean[x] = new_mean;
    row.deviation[x] = new_deviation;
    row.unrest[x] = static_cast<Byte>(new_unrest);
    row.low[x] = low_bound(new_mean, new_wide, new_unrest);
    row.high[x] = high_bound(new_mean, new_wide, new_unrest);
    row.candidate[x] = static_cast<Byte>(stayed ? candidate : seen);
    row.turns[x] = static_cast<Byte>(is_settled ? Fixed(0) : new_turns);
  }
}

Bounds bounds_of(double threshold_sigmas, double typical_sigma_grey) {
  // 32 grey levels of deviation and more would not fit.
  const double most = std::max(min_sigma_grey, max_sigmas * typical_sigma_grey);
  return {static_cast<Fixed>(std::min(120.0, 16 * sigma_by_deviation * threshold_sigmas)),
          static_cast<Fixed>(128 * threshold_sigmas * min_sigma_grey),
          static_cast<Fixed>(std::min(4000.0, 128 * most / sigma_by_deviation))};
}

/// Whether any of `block` pixels is out of bounds.
inline bool any_changed(const Byte* __restrict grey, const Byte* __restrict low,
                        const Byte* __restrict high) {
  Byte beyond = 0;
  for (int i = 0; i < block; ++i) {
    const Byte above = static_cast<Byte>((grey[i] > high[i] ? grey[i] : high[i]) ^ high[i]);
    const Byte below = static_cast<Byte>((grey[i] < low[i] ? grey[i] : low[i]) ^ low[i]);
    beyond = static_cast<Byte>(beyond | above | below);
  }
  return beyond != 0;
}

}  // namespace

Background::Background(int width_px, int height_px, double threshold_sigmas)
    : threshold_sigmas_(threshold_sigmas),
      mean_(height_px, width_px, CV_16S, cv::Scalar(0)),
      deviation_(height_px, width_px, CV_16S, cv::Scalar(0)),
      unrest_(height_px, width_px, CV_8U, cv::Scalar(0)),
      candidate_(height_px, width_px, CV_8U, cv::Scalar(0)),
      candidate_turns_(height_px, width_px, CV_8U, cv::Scalar(0)),
      low_(height_px, width_px, CV_8U, cv::Scalar(0)),
      high_(height_px, width_px, CV_8U, cv::Scalar(255)),
      tiles_(tiles_a_side * tiles_a_side) {
  samples_.reserve(4 * samples_a_side * samples_a_side);
}

double Background::sigma_grey(int x, int y) const {
  return std::max(min_sigma_grey, sigma_by_deviation / unit * deviation_.at<Fixed>(y, x));
}

double Background::unrest_grey(int x, int y) const {
  return sigma_by_unrest * unrest_.at<Byte>(y, x);
}

Background::Outcome Background::compare_and_learn(const cv::Mat& grey,
                                                  std::vector<PixelRun>& changed) {
  changed.clear();
  const double ratio = brightness_ratio(grey);
  if (is_dark_ || is_saturated_) return Outcome::learning;  // nothing is to be learnt from it
  if (learnt_frames_ < first_frames) {
    learn_from_scratch(grey);
    return Outcome::learning;
  }
  const bool is_other_light = ratio > max_light_step || ratio < 1 / max_light_step;
  if (!is_other_light && std::abs(ratio - 1) > light_step) scale(ratio);
  compare(grey, changed);
  std::size_t count = 0;
  for (const PixelRun& run : changed) count += static_cast<std::size_t>(run.last - run.first + 1);
  is_shaken_ = is_everywhere(changed);
  shaken_frames_ = is_shaken_ ? shaken_frames_ + 1 : 0;
  if (static_cast<double>(count) > new_scene_fraction * static_cast<double>(grey.total()) ||
      shaken_frames_ > max_shaken_frames) {
    learnt_frames_ = shaken_frames_ = 0;
    looked_frames_ = 0;
    changed.clear();
    return Outcome::learning;
  }
  learn(grey);
  return Outcome::compared;
}

void Background::mark(const cv::Mat& grey, const cv::Rect& region, cv::Mat& mask) const {
  for (int y = 0; y < region.height; ++y) {
    const int row = region.y + y;
    const Byte *pixel = grey.ptr(row) + region.x, *low = low_.ptr(row) + region.x,
               *high = high_.ptr(row) + region.x;
    Byte* out = mask.ptr(y);
    for (int x = 0; x < region.width; ++x) out[x] = is_changed(pixel[x], low[x], high[x]) ? 255 : 0;
  }
}

void Background::learn_from_scratch(const cv::Mat& grey) {
  const int n = learnt_frames_++;
  if (n == 0) {
    deviation_.setTo(static_cast<double>(unit));
    unrest_.setTo(0);
  }
  for (int y = 0; y < grey.rows; ++y) {
    const Byte* pixel = grey.ptr(y);
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
  find_typical_sigma();
  part_noise_from_unrest();
}

/// What varied by more than the camera's noise moved while it was learnt.
void Background::part_noise_from_unrest() {
  const Fixed most = bounds_of(threshold_sigmas_, typical_sigma_grey_).most_deviation;
  for (int y = 0; y < mean_.rows; ++y) {
    Fixed* deviation = deviation_.ptr<Fixed>(y);
    for (int x = 0; x < mean_.cols; ++x) {
      if (deviation[x] <= most) continue;
      const int steps = unrest_by_deviation * deviation[x] / unit;
      unrest_.at<Byte>(y, x) = static_cast<Byte>(std::min<int>(steps, max_unrest));
      deviation[x] = most;
    }
    set_bounds(y);
  }
}

void Background::set_bounds(int y) {
  const Bounds bounds = bounds_of(threshold_sigmas_, typical_sigma_grey_);
  const Fixed *mean = mean_.ptr<Fixed>(y), *deviation = deviation_.ptr<Fixed>(y);
  const Byte* unrest = unrest_.ptr(y);
  Byte *low = low_.ptr(y), *high = high_.ptr(y);
  for (int x = 0; x < mean_.cols; ++x) {
    const Fixed wide = threshold(deviation[x], bounds.gain, bounds.floor);
    low[x] = low_bound(mean[x], wide, unrest[x]);
    high[x] = high_bound(mean[x], wide, unrest[x]);
  }
}

/// The picture's brightness over the background's; 1 where it cannot be told. The median over a
/// grid of pixels (whatever moves covers less than half of them), wherever their sums differ at
/// all.
double Background::brightness_ratio(const cv::Mat& grey) {
  const int step_x = std::max(1, grey.cols / samples_a_side);
  const int step_y = std::max(1, grey.rows / samples_a_side);
  int count = 0, dark = 0, saturated = 0, sum = 0, sum_mean = 0;
  for (int y = step_y / 2; y < grey.rows; y += step_y) {
    const Byte* row = grey.ptr(y);
    const Fixed* mean = mean_.ptr<Fixed>(y);
    for (int x = step_x / 2; x < grey.cols; x += step_x) {
      ++count;
      dark += row[x] < dark_grey;
      saturated += row[x] >= saturated_grey;
      sum += row[x];
      sum_mean += mean[x];
    }
  }
  is_dark_ = 20 * dark > 19 * count;
  is_saturated_ = 5 * saturated > 4 * count;
  if (std::abs(sum * unit - sum_mean) < 0.5 * light_step * sum_mean) return 1.0;
  samples_.clear();
  for (int y = step_y / 2; y < grey.rows; y += step_y)
    for (int x = step_x / 2; x < grey.cols; x += step_x) {
      const Byte pixel = grey.at<Byte>(y, x);
      const Fixed mean = mean_.at<Fixed>(y, x);
      if (mean > min_ratio_grey * unit && mean < saturated_grey * unit && pixel < saturated_grey)
        samples_.push_back(static_cast<float>(pixel * unit) / static_cast<float>(mean));
    }
  if (4 * samples_.size() < static_cast<std::size_t>(count)) return 1.0;
  const auto middle = samples_.begin() + static_cast<std::ptrdiff_t>(samples_.size() / 2);
  std::nth_element(samples_.begin(), middle, samples_.end());
  return *middle;
}

/// The median over the same grid.
void Background::find_typical_sigma() {
  const int step_x = std::max(1, mean_.cols / samples_a_side);
  const int step_y = std::max(1, mean_.rows / samples_a_side);
  samples_.clear();
  for (int y = step_y / 2; y < mean_.rows; y += step_y)
    for (int x = step_x / 2; x < mean_.cols; x += step_x)
      samples_.push_back(static_cast<float>(sigma_grey(x, y)));
  const auto middle = samples_.begin() + static_cast<std::ptrdiff_t>(samples_.size() / 2);
  std::nth_element(samples_.begin(), middle, samples_.end());
  typical_sigma_grey_ = *middle;
}

void Background::scale(double ratio) {
  const auto fixed = static_cast<int>(std::lround(ratio * 16384));
  for (int y = 0; y < mean_.rows; ++y) {
    Fixed* mean = mean_.ptr<Fixed>(y);
    for (int x = 0; x < mean_.cols; ++x)
      mean[x] = static_cast<Fixed>(std::min((mean[x] * fixed + 8192) >> 14, 255 * unit));
    set_bounds(y);
  }
}

void Background::compare(const cv::Mat& grey, std::vector<PixelRun>& changed) const {
  for (int y = 0; y < grey.rows; ++y) {
    const Byte *pixel = grey.ptr(y), *low = low_.ptr(y), *high = high_.ptr(y);
    const auto scan = [&](int from, int to) {
      for (int x = from; x < to; ++x) {
        if (!is_changed(pixel[x], low[x], high[x])) continue;
        if (!changed.empty() && changed.back().y == y && changed.back().last == x - 1)
          changed.back().last = x;
        else
          changed.push_back({y, x, x});
      }
    };
    int x = 0;
    for (; x + block <= grey.cols; x += block)
      if (any_changed(pixel + x, low + x, high + x)) scan(x, x + block);
    scan(x, grey.cols);
  }
}

bool Background::is_everywhere(const std::vector<PixelRun>& changed) {
  std::ranges::fill(tiles_, 0);
  const int width = (mean_.cols + tiles_a_side - 1) / tiles_a_side;
  const int height = (mean_.rows + tiles_a_side - 1) / tiles_a_side;
  for (const PixelRun& run : changed)
    tiles_[static_cast<std::size_t>(run.y / height * tiles_a_side + run.first / width)] +=
        run.last - run.first + 1;
  const auto many = std::ranges::count_if(
      tiles_, [&](int pixels) { return pixels > shaken_share * width * height; });
  return static_cast<double>(many) > shaken_tiles * static_cast<double>(tiles_.size());
}

void Background::learn(const cv::Mat& grey) {
  const Bounds bounds = bounds_of(threshold_sigmas_, typical_sigma_grey_);
  const bool is_young = looked_frames_ < young_frames;
  const int turns = is_young ? young_turns : row_turns;
  const Pace pace = is_young ? Pace{young_shift, young_max_unrest, young_settled_turns}
                             : Pace{0, max_unrest, settled_turns};
  turn_ = (turn_ + 1) % turns;
  if (++looked_frames_ % typical_frames == 0) find_typical_sigma();
  for (int y = turn_; y < grey.rows; y += turns)
    learn_row(grey.ptr(y),
              {mean_.ptr<Fixed>(y), deviation_.ptr<Fixed>(y), unrest_.ptr(y), low_.ptr(y),
               high_.ptr(y), candidate_.ptr(y), candidate_turns_.ptr(y)},
              grey.cols, bounds, pace);
}

}  // namespace throwcal
