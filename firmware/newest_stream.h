// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <chrono>
#include <memory>
#include <span>
#include <string>

namespace throwcal {

/// What a client of an endless answer still has to get: the message that is on its way, and after
/// it the newest. Whoever reads slowly misses messages, never parts of them, and nothing piles up.
class NewestStream {
 public:
  using Clock = std::chrono::steady_clock;
  using Message = std::shared_ptr<const std::string>;

  explicit NewestStream(Clock::time_point now) : offered_at_(now) {}

  void offer(Message message, Clock::time_point now);  ///< takes the place of one that waits
  std::size_t read(std::span<char> out);               ///< as much as fits; 0: there is nothing
  bool is_empty() const { return !current_ && !next_; }
  Clock::time_point offered_at() const { return offered_at_; }  ///< the last one

 private:
  Message current_, next_;
  std::size_t sent_bytes_ = 0;  ///< of current_
  Clock::time_point offered_at_;
};

}  // namespace throwcal
