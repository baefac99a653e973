// SPDX-License-Identifier: BSD-3-Clause
#include "capture/rig.h"

#include <pthread.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <mutex>
#include <thread>
#include <utility>

#include "capture/frame_ring.h"
#include "capture/sighting_queue.h"

namespace throwcal {
namespace {

using Clock = std::chrono::steady_clock;

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

/// Linux keeps 15 characters of a thread's name.
void name_this_thread(const std::string& camera, const std::string& task) {
  pthread_setname_np(pthread_self(), (camera.substr(0, 15 - task.size()) + task).c_str());
}

/// One camera at work: a thread that grabs and, behind a ring, a thread that detects.
class Station {
 public:
  Station(std::unique_ptr<Camera> camera, const RigSettings& settings, SightingQueue& queue)
      : camera_(std::move(camera)),
        queue_(queue),
        detector_(camera_->model(), settings.ball_diameter_m, settings.detector),
        ring_(static_cast<std::size_t>(std::max(1, settings.ring_slots)),
              slot_bytes(camera_->format())) {
    stats_.name = camera_->name();
  }

  void start() {
    rate_since_ = Clock::now();
    stats_.running = true;
    grabber_ = std::thread([this] {
      name_this_thread(camera_->name(), "");
      guarded([this] { grab(); });
      ring_.close();
    });
    detecting_ = std::thread([this] {
      name_this_thread(camera_->name(), ".find");
      guarded([this] { detect(); });
      ring_.close();
      {
        const std::lock_guard lock(mutex_);
        stats_.running = false;
      }
      queue_.writer_done();
    });
  }

  void request_stop() {
    camera_->interrupt();
    ring_.abandon();
  }
  void join() {
    if (grabber_.joinable()) grabber_.join();
    if (detecting_.joinable()) detecting_.join();
  }

  CameraStats stats() const {
    const std::lock_guard lock(mutex_);
    CameraStats now = stats_;
    now.frames_dropped = ring_.dropped();
    return now;
  }

 private:
  template <typename Work>
  void guarded(const Work& work) {
    try {
      work();
    } catch (const std::exception& e) {
      fail(e.what());
    }
  }

  void fail(const std::string& why) {
    const std::lock_guard lock(mutex_);
    if (stats_.error.empty()) stats_.error = why;
  }

  void grab() {
    camera_->start();
    Frame frame;
    std::optional<std::uint64_t> last;
    for (;;) {
      if (camera_->waits_for_reader() && !ring_.wait_for_room()) return;
      const Camera::Outcome outcome = camera_->next(ring_.lease(), frame);
      switch (outcome) {
        case Camera::Outcome::frame:
        case Camera::Outcome::damaged:
          account(outcome, last ? frame.sequence - *last - 1 : 0);
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

  void account(Camera::Outcome outcome, std::uint64_t gap) {
    if (outcome == Camera::Outcome::frame && gap == 0 && !is_lost_) return;
    const std::lock_guard lock(mutex_);
    stats_.frames_lost_by_driver += gap;
    stats_.frames_damaged += outcome == Camera::Outcome::damaged;
    if (std::exchange(is_lost_, false)) stats_.error.clear();
  }

  void lose(const std::string& why) {
    const std::lock_guard lock(mutex_);
    stats_.interruptions += !std::exchange(is_lost_, true);
    stats_.error = why;
  }

  void detect() {
    while (const auto lease = ring_.take()) {
      FrameSightings found = detector_.detect(lease->frame());
      count(lease->frame(), found.sightings.size());
      queue_.push(std::move(found), camera_->waits_for_reader());
    }
  }

  void count(const Frame& frame, std::size_t sightings) {
    const std::lock_guard lock(mutex_);
    stats_.timestamp_source = frame.timestamp_source;
    stats_.time_sigma_s = seconds(frame.time_sigma);
    stats_.view = detector_.view();
    ++stats_.frames_by_view[static_cast<std::size_t>(stats_.view)];
    ++stats_.frames;
    stats_.sightings += sightings;
    ++rate_frames_;
    const auto now = Clock::now();
    if (now - rate_since_ < std::chrono::seconds(1)) return;
    stats_.frames_per_s = rate_frames_ / std::chrono::duration<double>(now - rate_since_).count();
    rate_since_ = now;
    rate_frames_ = 0;
  }

  std::unique_ptr<Camera> camera_;
  SightingQueue& queue_;
  BallDetector detector_;
  FrameRing ring_;
  std::thread grabber_, detecting_;
  mutable std::mutex mutex_;
  CameraStats stats_;
  bool is_lost_ = false;  ///< the grabbing thread's
  Clock::time_point rate_since_;
  int rate_frames_ = 0;
};

}  // namespace

struct Rig::Impl {
  SightingQueue queue;
  std::vector<std::unique_ptr<Station>> stations;
  bool started = false;
};

Rig::Rig(std::vector<std::unique_ptr<Camera>> cameras, const RigSettings& settings)
    : impl_(new Impl{SightingQueue(static_cast<std::size_t>(std::max(1, settings.queue_frames)),
                                   static_cast<int>(cameras.size())),
                     {},
                     false}) {
  for (auto& camera : cameras)
    impl_->stations.push_back(std::make_unique<Station>(std::move(camera), settings, impl_->queue));
}

Rig::~Rig() { stop(); }

void Rig::start() {
  if (std::exchange(impl_->started, true)) return;
  for (auto& station : impl_->stations) station->start();
}

std::optional<FrameSightings> Rig::next(std::stop_token stop) {
  return impl_->queue.pop(std::move(stop));
}

void Rig::stop() {
  if (!impl_->started) return;
  impl_->queue.close();
  for (auto& station : impl_->stations) station->request_stop();
  for (auto& station : impl_->stations) station->join();
}

std::vector<CameraStats> Rig::stats() const {
  std::vector<CameraStats> all;
  for (const auto& station : impl_->stations) all.push_back(station->stats());
  return all;
}

std::uint64_t Rig::sightings_dropped() const { return impl_->queue.dropped(); }

}  // namespace throwcal
