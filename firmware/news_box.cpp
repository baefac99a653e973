// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/news_box.h"

#include <sys/eventfd.h>
#include <unistd.h>

#include <cerrno>
#include <system_error>
#include <utility>

namespace throwcal {

NewsBox::NewsBox(std::size_t max_flights)
    : max_flights_(max_flights), fd_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
  if (fd_ < 0) throw std::system_error(errno, std::generic_category(), "eventfd");
}

NewsBox::~NewsBox() { close(fd_); }

void NewsBox::post(News news) {
  const std::scoped_lock lock(mutex_);
  if (news.session != 0 && news.session != waiting_.session) {
    const bool ended = waiting_.cameras_ended;
    waiting_ = {.session = news.session, .cameras_ended = ended};
  }
  for (Track& flight : news.flights) {
    if (waiting_.flights.size() < max_flights_)
      waiting_.flights.push_back(std::move(flight));
    else
      ++waiting_.flights_dropped;
  }
  if (news.calibration) {
    waiting_.calibration = std::move(news.calibration);
    waiting_.throws = news.throws;
    waiting_.calibrated_flights = news.calibrated_flights;
  }
  waiting_.solved |= news.solved;
  waiting_.cameras_ended |= news.cameras_ended;
  eventfd_write(fd_, 1);
}

News NewsBox::take() {
  const std::scoped_lock lock(mutex_);
  eventfd_t count = 0;
  eventfd_read(fd_, &count);
  return std::exchange(waiting_, {});
}

}  // namespace throwcal
