// SPDX-License-Identifier: BSD-3-Clause
#include "capture/ball_signal.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "capture/pixel_rows.h"

namespace throwcal {
namespace {

/// The world without the ball: its luma and how much luma and chroma vary in it, grey levels.
constexpr double world_luma = 90, sigma_luma = 25, sigma_chroma = 10;
/// What the world and the ball come out as.
constexpr double world_signal = 60, ball_signal = 210;
constexpr double max_weight = 2.0;  ///< more would only show the noise of the chroma

/// BT.601, full range: Y, U - 128, V - 128 of red, green, blue.
constexpr std::array<std::array<double, 3>, 3> yuv_of_rgb{
    {{0.299, 0.587, 0.114}, {-0.168736, -0.331264, 0.5}, {0.5, -0.418688, -0.081312}}};

std::uint8_t as_byte(double value) { return cv::saturate_cast<std::uint8_t>(value); }

/// U and V at a pixel of a row that has a pair of them for every second pixel, at the even ones.
struct ChromaRow {
  const std::uint8_t* pairs;  ///< U, then V `v_at` bytes on; the next pair `step` bytes on
  int step, v_at, last;       ///< last: index of the last pair

  std::array<double, 2> at(int x) const {
    const int left = std::min(x / 2, last), right = std::min((x + 1) / 2, last);
    const std::uint8_t *a = pairs + left * step, *b = pairs + right * step;
    return {0.5 * (a[0] + b[0]) - 128, 0.5 * (a[v_at] + b[v_at]) - 128};
  }
};

}  // namespace

BallSignal::BallSignal(std::optional<Colour> ball_colour) : has_colour_(ball_colour) {
  if (!ball_colour) return;
  std::array<double, 3> ball{};
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t k = 0; k < 3; ++k) ball[i] += yuv_of_rgb[i][k] * (*ball_colour)[k];
  const std::array<double, 3> differs{ball[0] - world_luma, ball[1], ball[2]};
  const std::array<double, 3> sigma{sigma_luma, sigma_chroma, sigma_chroma};
  double gain = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    weight_[i] = differs[i] / (sigma[i] * sigma[i]);
    gain += weight_[i] * differs[i];
  }
  const double largest =
      std::abs(std::ranges::max(weight_, {}, [](double w) { return std::abs(w); }));
  const double scale = std::min((ball_signal - world_signal) / std::max(gain, 1e-9),
                                max_weight / std::max(largest, 1e-9));
  for (double& weight : weight_) weight *= scale;
  offset_ = world_signal - weight_[0] * world_luma;
}

cv::Mat BallSignal::of(const ImageView& image) {
  auto* data = const_cast<std::uint8_t*>(image.data);  // cv::Mat has no view of const
  const auto view = [&](int type) {
    return cv::Mat(image.height_px, image.width_px, type, data, image.stride_bytes);
  };
  const bool has_chroma =
      image.format != PixelFormat::grey && image.width_px > 1 && image.height_px > 1;
  const bool is_plain = !has_colour_ || !has_chroma;
  if (is_plain && (image.format == PixelFormat::grey || image.format == PixelFormat::nv12))
    return view(CV_8UC1);  // NV12: its luma comes first
  signal_.create(image.height_px, image.width_px, CV_8UC1);
  if (image.format == PixelFormat::bgr) {
    if (is_plain) {
      cv::cvtColor(view(CV_8UC3), signal_, cv::COLOR_BGR2GRAY);
      return signal_;
    }
    cv::Matx14d mixture(0, 0, 0, offset_);
    for (int channel = 0; channel < 3; ++channel)  // blue, green, red
      for (std::size_t i = 0; i < 3; ++i)
        mixture(0, channel) += weight_[i] * yuv_of_rgb[i][static_cast<std::size_t>(2 - channel)];
    cv::transform(view(CV_8UC3), signal_, mixture);
    return signal_;
  }
  if (is_plain) {
    take_luma(view(CV_8UC2), 0, signal_);
    return signal_;
  }
  const bool is_packed = image.format == PixelFormat::yuyv;
  // Of an odd row or column at the end the frame need not hold the chroma: that beside it will do.
  const int last = image.width_px / 2 - 1, last_row = image.height_px / 2 - 1;
  for (int y = 0; y < image.height_px; ++y) {
    const std::uint8_t* luma = data + static_cast<std::size_t>(y) * image.stride_bytes;
    const std::uint8_t* pairs = is_packed
                                    ? luma + 1
                                    : data + (static_cast<std::size_t>(image.height_px) +
                                              static_cast<std::size_t>(std::min(y / 2, last_row))) *
                                                 image.stride_bytes;
    const ChromaRow chroma{pairs, is_packed ? 4 : 2, is_packed ? 2 : 1, last};
    std::uint8_t* out = signal_.ptr(y);
    for (int x = 0; x < image.width_px; ++x) {
      const auto [u, v] = chroma.at(x);
      out[x] = as_byte(offset_ + weight_[0] * luma[is_packed ? 2 * x : x] + weight_[1] * u +
                       weight_[2] * v);
    }
  }
  return signal_;
}

}  // namespace throwcal
