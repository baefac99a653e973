// SPDX-License-Identifier: BSD-3-Clause
#include "capture/simulated_background.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>

namespace throwcal {
namespace {

constexpr double darkest = 10.0, brightest = 92.0;

void add_texture(cv::Mat& picture, int cells, double strength, Dice& dice) {
  cv::Mat coarse(std::max(2, cells * picture.rows / picture.cols), cells, CV_32F), fine;
  for (float& value : cv::Mat_<float>(coarse)) value = static_cast<float>(strength * dice.normal());
  cv::resize(coarse, fine, picture.size(), 0, 0, cv::INTER_CUBIC);
  picture += fine;
}

void add_edges(cv::Mat& picture, Dice& dice) {
  const cv::Point a(cvRound(dice.uniform(0, picture.cols)), cvRound(dice.uniform(0, picture.rows)));
  const cv::Point b = a + cv::Point(cvRound(dice.uniform(-0.3, 0.3) * picture.cols),
                                    cvRound(dice.uniform(-0.3, 0.3) * picture.rows));
  const double grey = dice.uniform(20, 130);
  if (dice.uniform(0, 1) < 0.5)
    cv::line(picture, a, b, grey, cvRound(dice.uniform(1, 8)), cv::LINE_8);
  else
    cv::rectangle(picture, a, b, grey, cv::FILLED);
}

}  // namespace

cv::Mat simulated_background(int width_px, int height_px, Dice dice) {
  cv::Mat picture(height_px, width_px, CV_32F);
  const double slope_down = dice.uniform(15, 50), slope_across = dice.uniform(-25, 25);
  for (int y = 0; y < height_px; ++y)
    for (int x = 0; x < width_px; ++x)
      picture.at<float>(y, x) = static_cast<float>(55 + slope_down * (1.0 - 1.0 * y / height_px) +
                                                   slope_across * x / width_px);
  for (const auto& [cells, strength] : {std::pair(4, 18.0), {16, 11.0}, {64, 7.0}, {200, 4.0}})
    add_texture(picture, cells, strength, dice);
  for (int i = 0; i < 16; ++i) add_edges(picture, dice);
  picture = cv::max(darkest, cv::min(brightest, picture));
  for (int i = 0; i < 4; ++i) {
    const cv::Point at(cvRound(dice.uniform(0.05, 0.95) * width_px),
                       cvRound(dice.uniform(0.05, 0.95) * height_px));
    cv::circle(picture, at, cvRound(dice.uniform(3, 9)), dice.uniform(140, 200), cv::FILLED);
  }
  cv::GaussianBlur(picture, picture, {}, 0.7);
  return picture;
}

}  // namespace throwcal
