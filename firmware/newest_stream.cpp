// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/newest_stream.h"

#include <algorithm>
#include <utility>

namespace throwcal {

void NewestStream::offer(Message message, Clock::time_point now) {
  next_ = std::move(message);
  offered_at_ = now;
}

std::size_t NewestStream::read(std::span<char> out) {
  std::size_t count = 0;
  while (count < out.size() && !is_empty()) {
    if (!current_) current_ = std::exchange(next_, nullptr);
    const std::size_t part = current_->copy(out.data() + count, out.size() - count, sent_bytes_);
    count += part;
    sent_bytes_ += part;
    if (sent_bytes_ < current_->size()) break;
    current_.reset();
    sent_bytes_ = 0;
  }
  return count;
}

}  // namespace throwcal
