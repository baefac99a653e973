// SPDX-License-Identifier: BSD-3-Clause
#include "capture/raw_picture.h"

#include <linux/videodev2.h>

#include <algorithm>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "capture/pixel_rows.h"

namespace throwcal {
namespace {

bool is_packed_yuv(std::uint32_t fourcc) {
  return fourcc == V4L2_PIX_FMT_YUYV || fourcc == V4L2_PIX_FMT_UYVY;
}

/// OpenCV names a Bayer pattern by the second row's second and third pixel.
struct BayerCodes {
  std::uint32_t fourcc;
  int to_grey, to_bgr;
};
constexpr std::array bayer_codes{
    BayerCodes{V4L2_PIX_FMT_SBGGR8, cv::COLOR_BayerRG2GRAY, cv::COLOR_BayerRG2BGR},
    BayerCodes{V4L2_PIX_FMT_SGBRG8, cv::COLOR_BayerGR2GRAY, cv::COLOR_BayerGR2BGR},
    BayerCodes{V4L2_PIX_FMT_SGRBG8, cv::COLOR_BayerGB2GRAY, cv::COLOR_BayerGB2BGR},
    BayerCodes{V4L2_PIX_FMT_SRGGB8, cv::COLOR_BayerBG2GRAY, cv::COLOR_BayerBG2BGR}};

const BayerCodes* bayer(std::uint32_t fourcc) {
  const auto* found = std::ranges::find(bayer_codes, fourcc, &BayerCodes::fourcc);
  return found == bayer_codes.end() ? nullptr : found;
}

PixelFormat made_of(const V4l2Format& raw, bool colour) {
  if (!colour || raw.fields != Fields::progressive || raw.fourcc == V4L2_PIX_FMT_GREY)
    return PixelFormat::grey;
  if (raw.fourcc == V4L2_PIX_FMT_NV12) return PixelFormat::nv12;
  return is_packed_yuv(raw.fourcc) ? PixelFormat::yuyv : PixelFormat::bgr;
}

cv::Mat view(const V4l2Format& raw, std::span<const std::uint8_t> bytes, int rows) {
  auto* data = const_cast<std::uint8_t*>(bytes.data());  // cv::Mat has no view of const
  return {rows, raw.width_px, is_packed_yuv(raw.fourcc) ? CV_8UC2 : CV_8UC1, data,
          raw.stride_bytes};
}

}  // namespace

RawPicture::RawPicture(const V4l2Format& format, bool colour)
    : raw_(format),
      made_(made_of(format, colour)),
      height_px_(format.fields == Fields::alternate ? 2 * format.height_px : format.height_px) {}

bool RawPicture::write(std::span<const std::uint8_t> bytes, std::span<std::uint8_t> slot) {
  const int rows = raw_.height_px, columns = raw_.width_px;
  const bool is_colour = made_ == PixelFormat::bgr;
  cv::Mat out(rows, columns, is_colour ? CV_8UC3 : CV_8UC1, slot.data());
  if (is_compressed(raw_.fourcc)) {
    if (bytes.size() < 2 || bytes[0] != 0xFF || bytes[1] != 0xD8) return false;
    auto* data = const_cast<std::uint8_t*>(bytes.data());
    const cv::Mat coded(1, static_cast<int>(bytes.size()), CV_8UC1, data);
    const int flags = is_colour ? cv::IMREAD_COLOR : cv::IMREAD_GRAYSCALE;
    if (cv::imdecode(coded, flags, &decoded_).empty()) return false;
    if (decoded_.size() != out.size() || decoded_.type() != out.type()) return false;
    decoded_.copyTo(out);
    return true;
  }
  const cv::Mat raw = view(raw_, bytes, rows);
  if (const BayerCodes* codes = bayer(raw_.fourcc)) {
    cv::cvtColor(raw, out, is_colour ? codes->to_bgr : codes->to_grey);
  } else if (made_ == PixelFormat::nv12) {
    const int all_rows = rows + rows / 2;
    cv::Mat whole(all_rows, columns, CV_8UC1, slot.data());
    view(raw_, bytes, all_rows).copyTo(whole);
  } else if (made_ == PixelFormat::yuyv) {
    cv::Mat packed(rows, columns, CV_8UC2, slot.data());
    if (raw_.fourcc == V4L2_PIX_FMT_YUYV)
      raw.copyTo(packed);
    else
      cv::mixChannels({raw}, {packed}, {0, 1, 1, 0});
  } else if (is_packed_yuv(raw_.fourcc)) {
    take_luma(raw, raw_.fourcc == V4L2_PIX_FMT_YUYV ? 0 : 1, out);
  } else {
    raw.copyTo(out);
  }
  return true;
}

cv::Mat RawPicture::luma(const cv::Mat& raw) {
  if (!is_packed_yuv(raw_.fourcc)) return raw;
  luma_.create(raw.rows, raw.cols, CV_8UC1);
  take_luma(raw, raw_.fourcc == V4L2_PIX_FMT_YUYV ? 0 : 1, luma_);
  return luma_;
}

void RawPicture::write_field(std::span<const std::uint8_t> bytes, bool is_bottom,
                             std::span<std::uint8_t> slot) {
  cv::Mat field = luma(view(raw_, bytes, raw_.height_px));
  int first = 0, step = 1;
  if (raw_.fields != Fields::alternate) first = is_bottom ? 1 : 0, step = 2;
  const int lines = (field.rows - first + step - 1) / step;
  const auto line = [&](int n) { return field.ptr(first + step * std::clamp(n, 0, lines - 1)); };
  const int parity = is_bottom ? 1 : 0;
  for (int y = 0; y < height_px_; ++y) {
    std::uint8_t* out = slot.data() + static_cast<std::size_t>(y) * raw_.width_px;
    const int above = (y - parity) >> 1;  // rounds down
    const std::uint8_t *a = line(above), *b = (y - parity) % 2 == 0 ? a : line(above + 1);
    write_mean(a, b, raw_.width_px, out);
  }
}

}  // namespace throwcal
