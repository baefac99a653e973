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

int channel_type(PixelFormat format) {
  switch (format) {
    case PixelFormat::yuyv:
      return CV_8UC2;
    case PixelFormat::bgr:
      return CV_8UC3;
    case PixelFormat::grey:
    case PixelFormat::nv12:  // its first plane
      break;
  }
  return CV_8UC1;
}

/// The picture without copying it; of a picture far larger than a preview only every n-th row, for
/// nobody sees the others.
cv::Mat rows_of(const ImageView& image, int every) {
  return {image.height_px / every, image.width_px, channel_type(image.format),
          const_cast<std::uint8_t*>(image.data), image.stride_bytes * static_cast<unsigned>(every)};
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
  const int every = std::max(1, image.height_px / (2 * size.height));
  cv::Mat small;
  cv::resize(rows_of(image, every), small, size, 0, 0, cv::INTER_AREA);
  cv::Mat luma = small;
  if (image.format == PixelFormat::yuyv) cv::extractChannel(small, luma, 0);
  if (image.format == PixelFormat::bgr) cv::cvtColor(small, luma, cv::COLOR_BGR2GRAY);
  return luma;
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
