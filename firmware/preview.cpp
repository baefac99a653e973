// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/preview.h"

#include <algorithm>
#include <cstdio>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace throwcal {
namespace {

constexpr int widest_px = 640, jpeg_quality = 75, fraction_bits = 4;
constexpr double gap_px = 4, smallest_ring_px = 7;

struct Layout {
  int pixel_bytes, luma_at;
};

Layout layout_of(PixelFormat format) {
  switch (format) {
    case PixelFormat::yuyv:
      return {2, 0};
    case PixelFormat::bgr:
      return {3, 1};  // green: near enough for a look
    case PixelFormat::grey:
    case PixelFormat::nv12:  // its first plane
      break;
  }
  return {1, 0};
}

/// The luma of every n-th pixel of every n-th row. Shared with the frame where that is all it has.
cv::Mat sampled_luma(const ImageView& image, int every) {
  const auto [pixel_bytes, luma_at] = layout_of(image.format);
  if (every == 1 && pixel_bytes == 1)
    return {image.height_px, image.width_px, CV_8UC1, const_cast<std::uint8_t*>(image.data),
            image.stride_bytes};
  cv::Mat luma((image.height_px + every - 1) / every, (image.width_px + every - 1) / every,
               CV_8UC1);
  const int step = every * pixel_bytes;
  for (int y = 0; y < luma.rows; ++y) {
    const std::uint8_t* in =
        image.data + static_cast<std::size_t>(y) * every * image.stride_bytes + luma_at;
    std::uint8_t* out = luma.ptr(y);
    for (int x = 0; x < luma.cols; ++x) out[x] = in[x * step];
  }
  return luma;
}

/// Black round white, so that it is seen on anything.
void draw_ring(cv::Mat& picture, cv::Point2d centre, double radius_px) {
  constexpr double one = 1 << fraction_bits;
  const cv::Point fine(cvRound(centre.x * one), cvRound(centre.y * one));
  const int radius = cvRound(radius_px * one);
  cv::circle(picture, fine, radius, cv::Scalar(0), 4, cv::LINE_AA, fraction_bits);
  cv::circle(picture, fine, radius, cv::Scalar(255), 2, cv::LINE_AA, fraction_bits);
}

}  // namespace

cv::Mat small_luma(const ImageView& image) {
  const double scale = std::min(1.0, static_cast<double>(widest_px) / image.width_px);
  const cv::Size size(std::max(1, cvRound(scale * image.width_px)),
                      std::max(1, cvRound(scale * image.height_px)));
  // To twice the size by leaving out, then by averaging: a picture of 12 megapixels takes 40 ms
  // where all of it is averaged.
  const cv::Mat samples =
      sampled_luma(image, std::max(1, (image.width_px + widest_px) / (2 * widest_px)));
  cv::Mat small;
  cv::resize(samples, small, size, 0, 0,
             samples.size() == size * 2 ? cv::INTER_AREA : cv::INTER_LINEAR);
  return small;
}

Preview make_preview(cv::Mat luma, double scale, std::span<const BallSighting> sightings) {
  Preview out;
  for (const BallSighting& ball : sightings) {
    const cv::Point2d centre((ball.center_px.x() + 0.5) * scale - 0.5,
                             (ball.center_px.y() + 0.5) * scale - 0.5);
    const double radius = ball.radius_px.value_or(0) * scale + gap_px;
    draw_ring(luma, centre, std::max(smallest_ring_px, radius));
    char place[48];
    std::snprintf(place, sizeof place, "%s%.1f,%.1f", out.balls.empty() ? "" : " ", centre.x,
                  centre.y);
    out.balls += place;
  }
  std::vector<unsigned char> jpeg;
  cv::imencode(".jpg", luma, jpeg, {cv::IMWRITE_JPEG_QUALITY, jpeg_quality});
  out.jpeg.assign(jpeg.begin(), jpeg.end());
  return out;
}

}  // namespace throwcal
