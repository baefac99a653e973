// SPDX-License-Identifier: BSD-3-Clause
#include "capture/frame_ring.h"

#include <cassert>

namespace throwcal {

FrameLease::~FrameLease() {
  if (ring_) ring_->release(slot_);
}

const Frame& FrameLease::frame() const { return ring_->frames_[slot_]; }

FrameRing::FrameRing(std::size_t frames, std::size_t slot_bytes)
    : memory_((frames + 1) * slot_bytes),
      slot_bytes_(slot_bytes),
      frames_(frames + 1),
      waiting_(frames),
      writers_(frames) {
  assert(frames > 0);
  for (std::size_t slot = 0; slot < frames; ++slot) free_.push_back(slot);
}

std::span<std::uint8_t> FrameRing::lease() {
  return {memory_.data() + writers_ * slot_bytes_, slot_bytes_};
}

bool FrameRing::publish(const Frame& frame) {
  {
    const std::lock_guard lock(mutex_);
    if (free_.empty() || closed_) {
      dropped_ += !closed_;
      return false;
    }
    frames_[writers_] = frame;
    waiting_[(first_waiting_ + waiting_count_++) % waiting_.size()] = writers_;
    writers_ = free_.back();
    free_.pop_back();
  }
  changed_.notify_all();
  return true;
}

std::optional<FrameLease> FrameRing::take() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [this] { return waiting_count_ || closed_; });
  if (!waiting_count_) return std::nullopt;
  const std::size_t slot = waiting_[first_waiting_];
  first_waiting_ = (first_waiting_ + 1) % waiting_.size();
  --waiting_count_;
  return std::make_optional<FrameLease>(*this, slot);
}

bool FrameRing::wait_for_room() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [this] { return !free_.empty() || closed_; });
  return !closed_;
}

void FrameRing::close() {
  {
    const std::lock_guard lock(mutex_);
    closed_ = true;
  }
  changed_.notify_all();
}

void FrameRing::abandon() {
  {
    const std::lock_guard lock(mutex_);
    closed_ = true;
    for (; waiting_count_; --waiting_count_) {
      free_.push_back(waiting_[first_waiting_]);
      first_waiting_ = (first_waiting_ + 1) % waiting_.size();
    }
  }
  changed_.notify_all();
}

void FrameRing::release(std::size_t slot) {
  {
    const std::lock_guard lock(mutex_);
    free_.push_back(slot);
  }
  changed_.notify_all();
}

std::uint64_t FrameRing::dropped() const {
  const std::lock_guard lock(mutex_);
  return dropped_;
}

}  // namespace throwcal
