// SPDX-License-Identifier: BSD-3-Clause
#include "capture/rig.h"

#include <algorithm>
#include <chrono>
#include <mutex>
#include <thread>
#include <utility>

#include "capture/grabber.h"
#include "capture/sighting_crops.h"
#include "capture/sighting_queue.h"

namespace throwcal {
namespace {

using Clock = std::chrono::steady_clock;

/// One camera at work: a thread that grabs and, behind its ring, a thread that detects.
class Station {
 public:
  Station(std::unique_ptr<Camera> camera, const RigSettings& settings, SightingQueue& queue)
      : queue_(queue),
        detector_(camera->model(), settings.ball_diameter_m, settings.detector),
        grabber_(std::move(camera), settings.ring_slots),
        crops_(settings.crop_bytes) {
    stats_.name = grabber_.camera().name();
  }

  void start() {
    rate_since_ = Clock::now();
    stats_.running = true;
    grabber_.start();
    detecting_ = std::thread([this] {
      name_this_thread(grabber_.camera().name(), ".find");
      try {
        detect();
      } catch (const std::exception& e) {
        grabber_.fail(e.what());
      }
      grabber_.request_stop();
      {
        const std::lock_guard lock(mutex_);
        stats_.running = false;
      }
      queue_.writer_done();
    });
  }

  void request_stop() { grabber_.request_stop(); }
  std::optional<PictureCrop> crop_of(const BallSighting& sighting) const {
    return crops_.find(sighting);
  }
  std::optional<FrameLease> newest() { return grabber_.newest(); }
  void join() {
    if (detecting_.joinable()) detecting_.join();
    grabber_.join();
  }

  FrameSightings last_sightings() const {
    const std::lock_guard lock(mutex_);
    return last_;
  }

  CameraStats stats() const {
    const std::lock_guard lock(mutex_);
    CameraStats now = stats_;
    static_cast<GrabberStats&>(now) = grabber_.stats();
    now.running = stats_.running && now.error.empty();
    now.identity = grabber_.camera().identity();
    now.settings = grabber_.camera().settings();
    return now;
  }

 private:
  void detect() {
    while (const auto lease = grabber_.take()) {
      FrameSightings found = detector_.detect(lease->frame());
      count(lease->frame(), found);
      crops_.keep(lease->frame(), found.sightings);
      queue_.push(std::move(found), grabber_.camera().waits_for_reader());
    }
  }

  void count(const Frame& frame, const FrameSightings& found) {
    const std::lock_guard lock(mutex_);
    last_ = found;
    stats_.timestamp_source = frame.timestamp_source;
    stats_.time_sigma_s = seconds(frame.time_sigma);
    stats_.view = detector_.view();
    ++stats_.frames_by_view[static_cast<std::size_t>(stats_.view)];
    ++stats_.frames;
    stats_.sightings += found.sightings.size();
    ++rate_frames_;
    const auto now = Clock::now();
    if (now - rate_since_ < std::chrono::seconds(1)) return;
    stats_.frames_per_s = rate_frames_ / std::chrono::duration<double>(now - rate_since_).count();
    rate_since_ = now;
    rate_frames_ = 0;
  }

  SightingQueue& queue_;
  BallDetector detector_;
  Grabber grabber_;
  SightingCrops crops_;
  std::thread detecting_;
  mutable std::mutex mutex_;
  CameraStats stats_;
  FrameSightings last_;
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

std::optional<FrameLease> Rig::newest(CameraId camera) {
  return impl_->stations.at(camera)->newest();
}

std::optional<PictureCrop> Rig::crop_of(const BallSighting& sighting) const {
  return impl_->stations.at(sighting.camera)->crop_of(sighting);
}

FrameSightings Rig::last_sightings(CameraId camera) const {
  return impl_->stations.at(camera)->last_sightings();
}

std::vector<CameraStats> Rig::stats() const {
  std::vector<CameraStats> all;
  for (const auto& station : impl_->stations) all.push_back(station->stats());
  return all;
}

std::uint64_t Rig::sightings_dropped() const { return impl_->queue.dropped(); }

}  // namespace throwcal
