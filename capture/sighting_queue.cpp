// SPDX-License-Identifier: BSD-3-Clause
#include "capture/sighting_queue.h"

#include <utility>

namespace throwcal {

SightingQueue::SightingQueue(std::size_t frames, int writers)
    : frames_(frames), writers_(writers) {}

void SightingQueue::push(FrameSightings frame, bool may_wait) {
  {
    std::unique_lock lock(mutex_);
    if (may_wait) changed_.wait(lock, [this] { return count_ < frames_.size() || closed_; });
    if (count_ == frames_.size()) {
      ++dropped_;
      return;
    }
    frames_[(first_ + count_++) % frames_.size()] = std::move(frame);
  }
  changed_.notify_all();
}

std::optional<FrameSightings> SightingQueue::pop(std::stop_token stop) {
  std::optional<FrameSightings> oldest;
  {
    std::unique_lock lock(mutex_);
    if (!changed_.wait(lock, stop, [this] { return count_ || !writers_; }) || !count_)
      return std::nullopt;
    oldest = std::move(frames_[first_]);
    first_ = (first_ + 1) % frames_.size();
    --count_;
  }
  changed_.notify_all();
  return oldest;
}

void SightingQueue::writer_done() {
  {
    const std::lock_guard lock(mutex_);
    --writers_;
  }
  changed_.notify_all();
}

void SightingQueue::close() {
  {
    const std::lock_guard lock(mutex_);
    closed_ = true;
  }
  changed_.notify_all();
}

std::uint64_t SightingQueue::dropped() const {
  const std::lock_guard lock(mutex_);
  return dropped_;
}

}  // namespace throwcal
