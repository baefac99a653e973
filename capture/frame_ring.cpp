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
      holders_(frames + 1),
      writers_(frames) {
  assert(frames > 0);
  in_order_.reserve(frames);
  for (std::size_t slot = 0; slot < frames; ++slot) unused_.push_back(slot);
}

std::span<std::uint8_t> FrameRing::lease() {
  return {memory_.data() + writers_ * slot_bytes_, slot_bytes_};
}

/// Where in in_order_ the frame is that gives way to a new one.
std::optional<std::size_t> FrameRing::oldest_unheld() const {
  for (std::size_t i = 0; i < taken_; ++i)
    if (holders_[in_order_[i]] == 0) return i;
  return std::nullopt;
}

bool FrameRing::publish(const Frame& frame) {
  {
    const std::lock_guard lock(mutex_);
    if (closed_) return false;
    std::size_t next = 0;
    if (!unused_.empty()) {
      next = unused_.back();
      unused_.pop_back();
    } else if (const auto oldest = oldest_unheld()) {
      next = in_order_[*oldest];
      in_order_.erase(in_order_.begin() + static_cast<std::ptrdiff_t>(*oldest));
      --taken_;
    } else {
      ++dropped_;
      return false;
    }
    frames_[writers_] = frame;
    in_order_.push_back(std::exchange(writers_, next));
  }
  changed_.notify_all();
  return true;
}

std::optional<FrameLease> FrameRing::take() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [this] { return taken_ < in_order_.size() || closed_; });
  if (taken_ == in_order_.size()) return std::nullopt;
  const std::size_t slot = in_order_[taken_++];
  ++holders_[slot];
  return std::make_optional<FrameLease>(*this, slot);
}

std::vector<FrameLease> FrameRing::freeze(HostTime since) {
  const std::lock_guard lock(mutex_);
  std::vector<FrameLease> out;
  for (const std::size_t slot : in_order_) {
    if (frames_[slot].row0_mid_exposure < since) continue;
    ++holders_[slot];
    out.emplace_back(*this, slot);
  }
  return out;
}

std::optional<FrameLease> FrameRing::newest() {
  const std::lock_guard lock(mutex_);
  if (in_order_.empty()) return std::nullopt;
  ++holders_[in_order_.back()];
  return std::make_optional<FrameLease>(*this, in_order_.back());
}

bool FrameRing::wait_for_room() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [this] { return !unused_.empty() || oldest_unheld() || closed_; });
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
    taken_ = in_order_.size();
  }
  changed_.notify_all();
}

void FrameRing::release(std::size_t slot) {
  {
    const std::lock_guard lock(mutex_);
    --holders_[slot];
  }
  changed_.notify_all();
}

std::uint64_t FrameRing::dropped() const {
  const std::lock_guard lock(mutex_);
  return dropped_;
}

}  // namespace throwcal
