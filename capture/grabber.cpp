// SPDX-License-Identifier: BSD-3-Clause
#include "capture/grabber.h"

#include <pthread.h>

#include <algorithm>
#include <exception>
#include <utility>

namespace throwcal {
namespace {

std::size_t slot_bytes(const Camera::Format& format) {
  const std::size_t pixels = static_cast<std::size_t>(format.width_px) * format.height_px;
  switch (format.format) {
    case PixelFormat::grey:
      return pixels;
    case PixelFormat::nv12:
      return pixels + (pixels + 1) / 2;
    case PixelFormat::yuyv:
      return 2 * pixels;
    case PixelFormat::bgr:
      return 3 * pixels;
  }
  return 3 * pixels;
}

}  // namespace

std::size_t ring_bytes(const Camera::Format& format, std::size_t frames) {
  return (frames + 1) * slot_bytes(format);
}

void name_this_thread(const std::string& camera, const std::string& task) {
  pthread_setname_np(pthread_self(), (camera.substr(0, 15 - task.size()) + task).c_str());
}

Grabber::Grabber(std::unique_ptr<Camera> camera, std::size_t ring_slots)
    : camera_(std::move(camera)),
      ring_(std::max<std::size_t>(1, ring_slots), slot_bytes(camera_->format())) {}

Grabber::~Grabber() {
  request_stop();
  join();
}

void Grabber::start() {
  {
    const std::lock_guard lock(mutex_);
    stats_.running = true;
  }
  thread_ = std::thread([this] {
    name_this_thread(camera_->name(), "");
    try {
      grab();
    } catch (const std::exception& e) {
      fail(e.what());
    }
    {
      const std::lock_guard lock(mutex_);
      stats_.running = false;
    }
    ring_.close();
  });
}

void Grabber::request_stop() {
  camera_->interrupt();
  ring_.abandon();
}

void Grabber::join() {
  if (thread_.joinable()) thread_.join();
}

GrabberStats Grabber::stats() const {
  const std::lock_guard lock(mutex_);
  GrabberStats now = stats_;
  now.frames_dropped = ring_.dropped();
  return now;
}

void Grabber::fail(const std::string& why) {
  const std::lock_guard lock(mutex_);
  if (stats_.error.empty() || is_lost_) stats_.error = why;
}

void Grabber::grab() {
  camera_->start();
  Frame frame;
  std::optional<std::uint64_t> last;
  for (;;) {
    if (camera_->waits_for_reader() && !ring_.wait_for_room()) return;
    const Camera::Outcome outcome = camera_->next(ring_.lease(), frame);
    switch (outcome) {
      case Camera::Outcome::frame:
      case Camera::Outcome::damaged:
        account(outcome, last && frame.sequence > *last ? frame.sequence - *last - 1 : 0);
        last = frame.sequence;
        if (outcome == Camera::Outcome::frame) ring_.publish(frame);
        break;
      case Camera::Outcome::lost:
        lose(camera_->error());
        break;
      case Camera::Outcome::failed:
        fail(camera_->error());
        return;
      case Camera::Outcome::end:
      case Camera::Outcome::interrupted:
        return;
    }
  }
}

void Grabber::account(Camera::Outcome outcome, std::uint64_t gap) {
  if (outcome == Camera::Outcome::frame && gap == 0 && !is_lost_) return;
  const std::lock_guard lock(mutex_);
  stats_.frames_lost_by_driver += gap;
  stats_.frames_damaged += outcome == Camera::Outcome::damaged;
  if (std::exchange(is_lost_, false)) stats_.error.clear();
}

void Grabber::lose(const std::string& why) {
  const std::lock_guard lock(mutex_);
  stats_.interruptions += !std::exchange(is_lost_, true);
  stats_.error = why;
}

}  // namespace throwcal
