// SPDX-License-Identifier: BSD-3-Clause
#include "capture/raw_picture.h"

#include <gtest/gtest.h>
#include <linux/videodev2.h>

#include <opencv2/imgcodecs.hpp>

namespace throwcal {
namespace {

constexpr int width = 8, height = 6;

std::uint8_t luma(int x, int y) { return static_cast<std::uint8_t>(20 + 10 * x + y); }

V4l2Format format(std::uint32_t fourcc, std::size_t stride, Fields fields = Fields::progressive) {
  V4l2Format out;
  out.fourcc = fourcc, out.width_px = width, out.height_px = height, out.stride_bytes = stride;
  out.fields = fields;
  return out;
}

/// Rows longer than their pixels, as drivers pad them; U is 100, V is 200.
std::vector<std::uint8_t> packed(std::size_t stride, int luma_at) {
  std::vector<std::uint8_t> out(stride * height, 0xEE);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      std::uint8_t* pixel =
          &out[static_cast<std::size_t>(y) * stride + 2 * static_cast<std::size_t>(x)];
      pixel[luma_at] = luma(x, y);
      pixel[1 - luma_at] = x % 2 ? 200 : 100;
    }
  return out;
}

void expect_luma(const std::vector<std::uint8_t>& slot, std::size_t step) {
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      ASSERT_EQ(slot[step * static_cast<std::size_t>(y * width + x)], luma(x, y)) << x << ", " << y;
}

TEST(RawPicture, TakesTheLumaOfPackedYuvWhereColourIsNotWanted) {
  for (const auto& [fourcc, luma_at] :
       {std::pair(V4L2_PIX_FMT_YUYV, 0), std::pair(V4L2_PIX_FMT_UYVY, 1)}) {
    RawPicture picture(format(fourcc, 20), false);
    ASSERT_EQ(picture.format(), PixelFormat::grey);
    std::vector<std::uint8_t> slot(width * height);
    ASSERT_TRUE(picture.write(packed(20, luma_at), slot));
    expect_luma(slot, 1);
  }
}

TEST(RawPicture, KeepsTheChromaOfBothOrdersAsYuyv) {
  for (const auto& [fourcc, luma_at] :
       {std::pair(V4L2_PIX_FMT_YUYV, 0), std::pair(V4L2_PIX_FMT_UYVY, 1)}) {
    RawPicture picture(format(fourcc, 20), true);
    ASSERT_EQ(picture.format(), PixelFormat::yuyv);
    std::vector<std::uint8_t> slot(2 * width * height);
    ASSERT_TRUE(picture.write(packed(20, luma_at), slot));
    expect_luma(slot, 2);
    EXPECT_EQ(slot[1], 100);
    EXPECT_EQ(slot[3], 200);
  }
}

TEST(RawPicture, CopiesGreyAndTheTwoPlanesOfNv12WithoutTheirPadding) {
  std::vector<std::uint8_t> raw(12 * (height + height / 2), 0xEE);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) raw[static_cast<std::size_t>(12 * y + x)] = luma(x, y);
  for (int y = 0; y < height / 2; ++y)
    for (int x = 0; x < width; ++x)
      raw[static_cast<std::size_t>(12 * (height + y) + x)] = x % 2 ? 200 : 100;
  std::vector<std::uint8_t> slot(width * height * 3 / 2);
  for (const bool colour : {false, true}) {
    RawPicture nv12(format(V4L2_PIX_FMT_NV12, 12), colour);
    EXPECT_EQ(nv12.format(), colour ? PixelFormat::nv12 : PixelFormat::grey);
    ASSERT_TRUE(nv12.write(raw, slot));
    expect_luma(slot, 1);
  }
  EXPECT_EQ(slot[width * height], 100);
  EXPECT_EQ(slot[width * height + 1], 200);
  RawPicture grey(format(V4L2_PIX_FMT_GREY, 12), true);
  EXPECT_EQ(grey.format(), PixelFormat::grey);
  ASSERT_TRUE(grey.write(raw, slot));
  expect_luma(slot, 1);
}

// A red world: the sites of red are bright, the others dark.
TEST(RawPicture, KnowsWhereTheRedOfEachBayerPatternIs) {
  const struct {
    std::uint32_t fourcc;
    int x, y;
  } patterns[] = {{V4L2_PIX_FMT_SRGGB8, 0, 0},
                  {V4L2_PIX_FMT_SGRBG8, 1, 0},
                  {V4L2_PIX_FMT_SGBRG8, 0, 1},
                  {V4L2_PIX_FMT_SBGGR8, 1, 1}};
  for (const auto& [fourcc, red_x, red_y] : patterns) {
    std::vector<std::uint8_t> raw(width * height, 10);
    for (int y = red_y; y < height; y += 2)
      for (int x = red_x; x < width; x += 2) raw[static_cast<std::size_t>(y * width + x)] = 210;
    RawPicture picture(format(fourcc, width), true);
    ASSERT_EQ(picture.format(), PixelFormat::bgr);
    std::vector<std::uint8_t> slot(3 * width * height);
    ASSERT_TRUE(picture.write(raw, slot));
    const std::uint8_t* middle = &slot[3 * (3 * width + 4)];
    EXPECT_EQ(middle[0], 10) << fourcc_text(fourcc);
    EXPECT_EQ(middle[1], 10) << fourcc_text(fourcc);
    EXPECT_EQ(middle[2], 210) << fourcc_text(fourcc);
  }
}

TEST(RawPicture, DecodesJpegAndRefusesWhatIsNone) {
  const cv::Mat grey(height, width, CV_8UC1, cv::Scalar(90));
  std::vector<std::uint8_t> coded;
  cv::imencode(".jpg", grey, coded);
  RawPicture picture(format(V4L2_PIX_FMT_MJPEG, 0), false);
  std::vector<std::uint8_t> slot(width * height);
  ASSERT_TRUE(picture.write(coded, slot));
  EXPECT_NEAR(slot[20], 90, 1);
  coded.resize(coded.size() / 2);
  EXPECT_NO_THROW(static_cast<void>(picture.write(coded, slot)));
  const std::vector<std::uint8_t> nothing(40, 7);
  EXPECT_FALSE(picture.write(nothing, slot));
  cv::imencode(".jpg", cv::Mat(height + 2, width, CV_8UC1, cv::Scalar(90)), coded);
  EXPECT_FALSE(picture.write(coded, slot)) << "of another size";
}

// A slope down the picture: each field alone gives it back, on the whole picture's rows.
TEST(RawPicture, AFieldBecomesAWholePictureOnItsOwnRows) {
  std::vector<std::uint8_t> raw(width * height);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      raw[static_cast<std::size_t>(y * width + x)] = static_cast<std::uint8_t>(20 * y);
  RawPicture picture(format(V4L2_PIX_FMT_GREY, width, Fields::interlaced), false);
  std::vector<std::uint8_t> slot(width * height);
  for (const bool is_bottom : {false, true}) {
    picture.write_field(raw, is_bottom, slot);
    for (int y = 1; y + 1 < height; ++y)
      EXPECT_EQ(slot[static_cast<std::size_t>(y * width)], 20 * y) << is_bottom << y;
  }
  V4l2Format half = format(V4L2_PIX_FMT_GREY, width, Fields::alternate);
  half.height_px = height / 2;
  RawPicture bottom(half, false);
  ASSERT_EQ(bottom.height_px(), height);
  std::vector<std::uint8_t> lines;
  for (int y = 1; y < height; y += 2)
    lines.insert(lines.end(), width, static_cast<std::uint8_t>(20 * y));
  bottom.write_field(lines, true, slot);
  for (int y = 1; y < height; ++y)
    EXPECT_EQ(slot[static_cast<std::size_t>(y * width)], 20 * y) << y;
}

}  // namespace
}  // namespace throwcal
