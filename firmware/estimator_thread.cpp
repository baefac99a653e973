// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/estimator_thread.h"

#include <pthread.h>

#include <algorithm>
#include <chrono>
#include <utility>

#include "firmware/cameras.h"

namespace throwcal {
namespace {

using namespace std::chrono_literals;

/// A throw's flights end in one camera after the other; after this long, all have.
constexpr HostClock::duration settling_time = 300ms;
/// Of the time between calibrations, so that frames never pile up behind them.
constexpr int pause_per_work = 2;

/// A flight that begins this soon after another ends is the same throw, bounced.
constexpr HostClock::duration longest_bounce = 300ms;

/// How often somebody threw: flights, those after a bounce not counted.
int times_thrown(const std::vector<Throw>& flights) {
  int count = 0;
  std::optional<HostTime> last_end;
  for (const Throw& flight : flights) {
    HostTime start = HostTime::max(), end = HostTime::min();
    for (const Track& track : flight.tracks) {
      start = std::min(start, track.sightings.front().time);
      end = std::max(end, track.sightings.back().time);
    }
    if (!last_end || start > *last_end + longest_bounce) ++count;
    last_end = std::max(end, last_end.value_or(end));
  }
  return count;
}

/// Leaves calibrate() when the box is switched off.
struct GivenUp {};

}  // namespace

EstimatorThread::EstimatorThread(const RigDescription& description, Rig& rig, NewsBox& news,
                                 HostClock::duration pre_trigger)
    : description_(description),
      rig_(rig),
      news_(news),
      pre_trigger_(pre_trigger),
      numbering_(description.cameras.size()),
      thread_([this](std::stop_token stop) { run(stop); }) {}

EstimatorThread::~EstimatorThread() = default;

void EstimatorThread::begin_session() { give(Order::begin); }
void EstimatorThread::finish_session() { give(Order::finish); }
void EstimatorThread::solve(std::vector<Track> flights) { give(Order::solve, std::move(flights)); }

bool EstimatorThread::stop_within(std::chrono::milliseconds time) {
  thread_.request_stop();
  std::unique_lock lock(mutex_);
  return ordered_.wait_for(lock, time, [this] { return has_ended_; });
}

void EstimatorThread::give(Order order, std::vector<Track> flights) {
  const std::scoped_lock lock(mutex_);
  orders_.emplace_back(order, std::move(flights));
  interrupt_.request_stop();
  ordered_.notify_all();
}

void EstimatorThread::run(std::stop_token stop) {
  pthread_setname_np(pthread_self(), "estimator");
  const std::stop_callback on_stop(stop, [this] {
    const std::scoped_lock lock(mutex_);
    interrupt_.request_stop();
  });
  while (!stop.stop_requested()) {
    std::vector<std::pair<Order, std::vector<Track>>> orders;
    std::stop_token interrupt;
    {
      const std::scoped_lock lock(mutex_);
      orders.swap(orders_);
      if (interrupt_.stop_requested() && !stop.stop_requested()) interrupt_ = {};
      interrupt = interrupt_.get_token();
    }
    for (auto& [order, flights] : orders) obey(order, std::move(flights), stop);
    if (cameras_ended_) {
      wait_for_order(stop);
    } else if (auto frame = rig_.next(interrupt)) {
      numbering_.number(*frame);
      search_ ? take(*frame, stop) : remember(std::move(*frame));
    } else if (!interrupt.stop_requested()) {
      cameras_ended_ = true;
      news_.post({.cameras_ended = true});
    }
  }
  const std::scoped_lock lock(mutex_);
  has_ended_ = true;
  ordered_.notify_all();
}

void EstimatorThread::wait_for_order(std::stop_token stop) {
  std::unique_lock lock(mutex_);
  ordered_.wait(lock, stop, [this] { return !orders_.empty(); });
}

void EstimatorThread::obey(Order order, std::vector<Track> flights, std::stop_token stop) {
  switch (order) {
    case Order::begin:
      search_.emplace(description_);
      calibrate_at_.reset();
      pause_ = {};
      for (const FrameSightings& frame : std::exchange(remembered_, {}))
        if (frame.time >= newest_ - pre_trigger_) take(frame, stop);
      newest_ = {};
      return;
    case Order::finish:
      if (search_) finish_search(stop);
      break;
    case Order::solve:
      search_.emplace(description_);
      for (Track& flight : flights) search_->add_flight(std::move(flight));
      break;
  }
  calibrate_now(stop, true);
  search_.reset();
}

/// What was seen before the order counts, though it may still wait to be looked at.
void EstimatorThread::finish_search(std::stop_token stop) {
  const HostTime ordered = host_now();
  std::stop_source no_waiting;
  no_waiting.request_stop();
  while (!stop.stop_requested()) {
    auto frame = rig_.next(no_waiting.get_token());
    if (!frame || frame->time > ordered) break;
    numbering_.number(*frame);
    if (auto flights = search_->add(*frame); !flights.empty())
      news_.post({.flights = std::move(flights)});
  }
  news_.post({.flights = search_->finish()});
}

void EstimatorThread::remember(FrameSightings frame) {
  newest_ = std::max(newest_, frame.time);
  remembered_.push_back(std::move(frame));
  while (!remembered_.empty() && remembered_.front().time < newest_ - pre_trigger_)
    remembered_.pop_front();
}

void EstimatorThread::take(const FrameSightings& frame, std::stop_token stop) {
  if (std::vector<Track> flights = search_->add(frame); !flights.empty()) {
    news_.post({.flights = std::move(flights)});
    // Never put off: with many flights the next would always come before the pause is over.
    if (!calibrate_at_)
      calibrate_at_ = frame.time + std::max<HostClock::duration>(settling_time, pause_);
  }
  if (calibrate_at_ && frame.time >= *calibrate_at_) {
    calibrate_at_.reset();
    calibrate_now(stop, false);
  }
}

void EstimatorThread::calibrate_now(std::stop_token stop, bool last) {
  const auto began = std::chrono::steady_clock::now();
  const std::vector<Throw> throws = search_->throws();
  if (throws.empty() && !last) return;
  CalibrateSettings settings;
  settings.progress = [&](double) {
    if (stop.stop_requested()) throw GivenUp{};
  };
  try {
    auto calibration =
        std::make_shared<const Calibration>(calibrate(description_, throws, settings));
    news_.post(
        {.throws = times_thrown(throws), .calibration = std::move(calibration), .solved = last});
  } catch (const GivenUp&) {
    return;  // its flights are stored: the next start solves them
  }
  pause_ = pause_per_work * (std::chrono::steady_clock::now() - began);
}

}  // namespace throwcal
