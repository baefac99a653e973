// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/news_box.h"

#include <gtest/gtest.h>
#include <poll.h>

namespace throwcal {
namespace {

bool is_readable(int fd) {
  pollfd asked{.fd = fd, .events = POLLIN, .revents = 0};
  return poll(&asked, 1, 0) == 1;
}

News flights_of(CameraId camera, std::size_t count) {
  News news;
  news.flights.assign(count, Track{camera, {}});
  return news;
}

News calibration_of(int throws, bool last) {
  News news;
  news.calibration = std::make_shared<Calibration>();
  news.throws = throws;
  news.solved = last;
  return news;
}

TEST(NewsBox, IsReadableWhileThereIsNews) {
  NewsBox box;
  EXPECT_FALSE(is_readable(box.fd()));
  box.post(flights_of(0, 1));
  EXPECT_TRUE(is_readable(box.fd()));
  box.take();
  EXPECT_FALSE(is_readable(box.fd()));
}

TEST(NewsBox, KeepsEveryFlightAndTheNewestCalibration) {
  NewsBox box;
  box.post(flights_of(0, 1));
  box.post(calibration_of(1, false));
  box.post(flights_of(1, 2));
  box.post(calibration_of(2, true));
  const News news = box.take();
  ASSERT_EQ(news.flights.size(), 3u);
  EXPECT_EQ(news.flights[2].camera, 1u);
  EXPECT_EQ(news.throws, 2);
  EXPECT_TRUE(news.calibration);
  EXPECT_TRUE(news.solved);
  EXPECT_FALSE(box.take().calibration);
}

TEST(NewsBox, CountsFlightsBeyondItsLimit) {
  NewsBox box(3);
  box.post(flights_of(0, 2));
  box.post(flights_of(1, 5));
  const News news = box.take();
  EXPECT_EQ(news.flights.size(), 3u);
  EXPECT_EQ(news.flights_dropped, 4u);
}

TEST(NewsBox, ForgetsWhatWaitsOfASessionThatAnotherFollowed) {
  NewsBox box;
  News first = flights_of(0, 2), second = flights_of(1, 1), ended;
  first.session = 1;
  second.session = 2;
  ended.cameras_ended = true;
  box.post(first);
  box.post(ended);
  box.post(second);
  const News news = box.take();
  EXPECT_EQ(news.session, 2);
  ASSERT_EQ(news.flights.size(), 1u);
  EXPECT_EQ(news.flights[0].camera, 1u);
  EXPECT_TRUE(news.cameras_ended);
}

}  // namespace
}  // namespace throwcal
