// SPDX-License-Identifier: BSD-3-Clause
#include "capture/sighting_crops.h"

#include <gtest/gtest.h>

namespace throwcal {
namespace {

using namespace std::chrono_literals;

/// Each pixel's brightness tells its place: (3 x + 5 y) modulo 256.
struct Picture {
  Picture(int width, int height, PixelFormat format) {
    const int bytes = format == PixelFormat::yuyv ? 2 : format == PixelFormat::bgr ? 3 : 1;
    pixels.assign(static_cast<std::size_t>(width * height * bytes), 7);
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        for (int b = 0; b < (bytes == 3 ? 3 : 1); ++b)
          pixels[static_cast<std::size_t>((y * width + x) * bytes + b)] = at(x, y);
    frame.image = {pixels.data(), width, height, static_cast<std::size_t>(width * bytes), format};
  }
  static std::uint8_t at(int x, int y) { return static_cast<std::uint8_t>(3 * x + 5 * y); }

  std::vector<std::uint8_t> pixels;
  Frame frame;
};

BallSighting sighting(HostTime time, double u_px, double v_px, double radius_px) {
  BallSighting out;
  out.time = time;
  out.center_px = {u_px, v_px};
  out.radius_px = radius_px;
  return out;
}

void expect_true_to(const PictureCrop& crop, int tolerance) {
  for (int j = 0; j < crop.area.height; ++j)
    for (int i = 0; i < crop.area.width; ++i)
      ASSERT_NEAR(crop.pixels.at(static_cast<std::size_t>(j * crop.area.width + i)),
                  Picture::at(crop.area.x_px + i * crop.area.step_px,
                              crop.area.y_px + j * crop.area.step_px),
                  tolerance)
          << i << ", " << j;
}

TEST(PictureCrop, IsTheBrightnessOfEveryPixelFormat) {
  for (const PixelFormat format :
       {PixelFormat::grey, PixelFormat::yuyv, PixelFormat::nv12, PixelFormat::bgr}) {
    const Picture picture(64, 48, format);
    // The weights of blue, green and red add up to 256 / 256: grey stays grey.
    expect_true_to(crop(picture.frame, {5, 6, 20, 10, 2}), format == PixelFormat::bgr ? 1 : 0);
  }
}

TEST(PictureCrop, LiesWithinThePictureWhereverTheBallIs) {
  const Picture picture(64, 48, PixelFormat::grey);
  for (const double u : {-1e9, -3.0, 0.0, 31.5, 63.0, 70.0, 1e9, std::nan("")})
    for (const double radius : {-1.0, 0.0, 5.0, 30.0, 1e12, std::nan("")}) {
      const CropArea area = around(picture.frame.image, u, 47.0, radius, 16);
      EXPECT_GT(area.width, 0);
      EXPECT_LE(area.width, 16);
      EXPECT_GE(area.x_px, 0);
      EXPECT_LE(area.x_px + (area.width - 1) * area.step_px, 63);
      EXPECT_LE(area.y_px + (area.height - 1) * area.step_px, 47);
      expect_true_to(crop(picture.frame, area), 0);
    }
}

TEST(PictureCrop, ThinsAWholePictureOut) {
  const Picture picture(1000, 500, PixelFormat::grey);
  const CropArea area = whole_picture(picture.frame.image, 640);
  EXPECT_EQ(area.step_px, 2);
  EXPECT_EQ(area.width, 500);
  EXPECT_EQ(area.height, 250);
}

TEST(SightingCrops, AreFoundUntilNewerOnesTakeTheirPlace) {
  Picture picture(64, 48, PixelFormat::grey);
  SightingCrops crops(3 * SightingCrops::side * SightingCrops::side);
  const auto at = [](int i) { return sighting(HostTime(i * 10ms), 20.0 + i, 24.0, 3.0); };
  EXPECT_FALSE(crops.find(sighting({}, 0, 0, 1))) << "nothing was kept yet";
  for (int i = 0; i < 4; ++i) crops.keep(picture.frame, {at(i)});
  EXPECT_FALSE(crops.find(at(0)));
  for (int i = 1; i < 4; ++i) {
    const auto found = crops.find(at(i));
    ASSERT_TRUE(found);
    EXPECT_EQ(found->time, at(i).time);
    EXPECT_EQ(found->area.width, 20) << "twice the radius and 4 px, to both sides";
    EXPECT_EQ(found->area.x_px, 10 + i);
    expect_true_to(*found, 0);
  }
  BallSighting other = at(2);
  other.center_px.x() += 1e-9;
  EXPECT_FALSE(crops.find(other));
}

TEST(SightingCrops, OfAFrameFullOfThemTheFirstAreKept) {
  const Picture picture(64, 48, PixelFormat::grey);
  SightingCrops crops(1'000'000);
  std::vector<BallSighting> many;
  for (int i = 0; i < 20; ++i) many.push_back(sighting(HostTime(1ms), i, 10.0, 3.0));
  crops.keep(picture.frame, many);
  EXPECT_TRUE(crops.find(many[SightingCrops::per_frame - 1]));
  EXPECT_FALSE(crops.find(many[SightingCrops::per_frame]));
}

}  // namespace
}  // namespace throwcal
