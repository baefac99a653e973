// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

#include "estimator/calibration.h"
#include "estimator/observation.h"

namespace throwcal {

/// What the estimator thread has to tell of a session.
struct News {
  std::int64_t session = 0;                          ///< whose it is
  std::vector<Track> flights{};                      ///< found since the last news
  std::uint64_t flights_dropped = 0;                 ///< the box was full
  int throws = 0;                                    ///< times somebody threw, of `calibration`
  std::size_t calibrated_flights = 0;                ///< it is of the session's first so many
  std::shared_ptr<const Calibration> calibration{};  ///< the newest, if there is a new one
  bool solved = false;                               ///< `calibration` is the session's last
  bool cameras_ended = false;  ///< every camera has ended: no more frames will come
};

/// Where the estimator thread and the main loop meet: the newest calibration and the flights that
/// nobody has taken yet. Bounded: flights beyond the limit are counted, not kept. What waits of a
/// session goes when there is news of another: it was thrown away.
class NewsBox {
 public:
  explicit NewsBox(std::size_t max_flights = 1024);
  ~NewsBox();
  NewsBox(const NewsBox&) = delete;
  NewsBox& operator=(const NewsBox&) = delete;

  void post(News news);  ///< merged with what waits
  News take();
  int fd() const { return fd_; }  ///< readable while there is news

 private:
  const std::size_t max_flights_;
  const int fd_;
  std::mutex mutex_;
  News waiting_;
};

}  // namespace throwcal
