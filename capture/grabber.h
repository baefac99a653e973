// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "capture/camera.h"
#include "capture/frame_ring.h"

namespace throwcal {

/// Counters of one camera's frames since start; every loss is in one of them.
struct GrabberStats {
  std::uint64_t frames_lost_by_driver = 0;  ///< gaps in the driver's sequence
  std::uint64_t frames_damaged = 0;         ///< the driver says so, or they can't be decoded
  std::uint64_t interruptions = 0;          ///< how often the camera was lost
  std::uint64_t frames_dropped = 0;         ///< ring full: the reader was too slow
  bool running = false;                     ///< false: ended or failed, `error` says why
  std::string error;                        ///< of a camera that runs: why there are no frames now
};

/// What a ring of so many frames takes.
std::size_t ring_bytes(const Camera::Format& format, std::size_t frames);

/// A camera's grabbing thread, named after it, and the ring that it fills.
class Grabber {
 public:
  Grabber(std::unique_ptr<Camera> camera, std::size_t ring_slots);
  ~Grabber();  ///< stops

  const Camera& camera() const { return *camera_; }
  void start();
  /// The oldest frame not taken yet; waits for one. Nothing once the camera has ended, failed or
  /// been stopped, and all frames are taken. One thread.
  std::optional<FrameLease> take() { return ring_.take(); }
  /// Every frame since then that the ring still has, taken or not, oldest first.
  std::vector<FrameLease> freeze(HostTime since) { return ring_.freeze(since); }
  std::optional<FrameLease> newest() { return ring_.newest(); }
  GrabberStats stats() const;         ///< thread-safe
  void fail(const std::string& why);  ///< thread-safe: the reader cannot go on, `why` is told
  void request_stop();                ///< thread-safe: take() returns nothing soon
  void join();

 private:
  void grab();
  void account(Camera::Outcome outcome, std::uint64_t gap);
  void lose(const std::string& why);

  std::unique_ptr<Camera> camera_;
  FrameRing ring_;
  std::thread thread_;
  mutable std::mutex mutex_;
  GrabberStats stats_;
  bool is_lost_ = false;  ///< the grabbing thread's
};

/// Linux keeps 15 characters of a thread's name: the camera's first ones, then the task.
void name_this_thread(const std::string& camera, const std::string& task);

}  // namespace throwcal
