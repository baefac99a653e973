// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <optional>
#include <stop_token>
#include <thread>
#include <vector>

#include "capture/rig.h"
#include "estimator/calibrate.h"
#include "firmware/news_box.h"
#include "firmware/throw_search.h"

namespace throwcal {

/// The one thread that estimates: takes every frame's sightings from the rig; in a session, looks
/// for flights in them, calibrates whenever there are new throws and posts what it found.
class EstimatorThread {
 public:
  /// Borrows rig and news for its life. `pre_trigger`: so much of what was seen before
  /// begin_session() belongs to the session, unless another session had it.
  EstimatorThread(const RigDescription& description, Rig& rig, NewsBox& news,
                  HostClock::duration pre_trigger);
  ~EstimatorThread();  ///< stops and joins

  void begin_session(std::int64_t session);
  /// Ends open flights, calibrates a last time, posts `solved`.
  void finish_session();
  /// Throws the session away; a calibration that is being made, too.
  void abandon_session();
  /// A session of before: calibrates its flights with its own rig, posts `solved`.
  void solve(std::int64_t session, const RigDescription& rig, std::vector<Track> flights);
  /// From the next session on; between two.
  void change(const Target& target, HostClock::duration pre_trigger);
  /// Gives up what it is doing, a calibration included. False: it is at work that can't be given up
  /// (putting flights of a long session together) and not done in time.
  bool stop_within(std::chrono::milliseconds time);
  /// Goes up while it works.
  std::uint64_t turns() const { return turns_; }
  bool is_waiting() const { return is_waiting_; }  ///< for a frame or an order

 private:
  struct Order {
    enum class Kind { begin, finish, abandon, solve, change } kind;
    std::int64_t session = 0;
    RigDescription rig = {};
    std::vector<Track> flights = {};
    Target target = {};
    HostClock::duration pre_trigger = {};
  };

  void give(Order order);
  std::optional<FrameSightings> next_frame(std::stop_token interrupt);
  void run(std::stop_token stop);
  void wait_for_order(std::stop_token stop);
  void obey(Order order, std::stop_token stop);
  void begin(std::int64_t session, std::stop_token stop);
  void finish_search(std::stop_token stop);
  void remember(FrameSightings frame);
  void take(const FrameSightings& frame, std::stop_token stop);
  void post_flights(std::vector<Track> flights);
  void calibrate_now(std::stop_token stop, bool last);

  RigDescription description_;  // of the sessions to come
  Rig& rig_;
  NewsBox& news_;
  HostClock::duration pre_trigger_;

  std::mutex mutex_;  // guards orders_, has_ended_ and interrupt_
  std::condition_variable_any ordered_;
  std::vector<Order> orders_;
  bool has_ended_ = false;
  std::atomic<std::uint64_t> turns_ = 0;
  std::atomic<bool> is_waiting_ = false;
  std::atomic<bool> is_abandoned_ = false;  ///< an order to abandon waits
  std::stop_source interrupt_;              // makes a waiting rig_.next() return; renewed each time

  // The thread's own:
  SightingNumbering numbering_;
  std::deque<FrameSightings> remembered_;  // while there is no session: the last pre_trigger_
  HostTime newest_{};                      // of a frame remembered
  std::optional<ThrowSearch> search_;
  FitMemory fits_;  // of the session's calibrations
  std::int64_t session_ = 0;
  RigDescription session_rig_;
  std::optional<HostTime> found_at_;      // when the first flight was that is in no calibration yet
  HostTime found_until_{};                // the last sighting of those flights
  HostTime rested_at_ = HostTime::min();  // before it, no calibration is made
  bool cameras_ended_ = false;

  std::jthread thread_;
};

}  // namespace throwcal
