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

/// A throw's flights end in one camera after the other. As long as a camera follows one that began
/// before those found ended, the calibration waits, but no longer than this: what seems to fly may
/// be a bird. An arc after a bounce is not waited for.
constexpr HostClock::duration longest_wait = 300ms;
/// Of the time between calibrations, so that frames never pile up behind them.
constexpr int rest_per_work = 1;

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

/// Leaves calibrate() when the box is switched off or the session thrown away.
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

void EstimatorThread::begin_session(std::int64_t session) { give({Order::Kind::begin, session}); }

void EstimatorThread::finish_session() { give({Order::Kind::finish}); }

void EstimatorThread::abandon_session() { give({Order::Kind::abandon}); }

void EstimatorThread::solve(std::int64_t session, const RigDescription& rig,
                            std::vector<Track> flights) {
  give({Order::Kind::solve, session, rig, std::move(flights)});
}

void EstimatorThread::change(const Target& target, HostClock::duration pre_trigger) {
  give({.kind = Order::Kind::change, .target = target, .pre_trigger = pre_trigger});
}

bool EstimatorThread::stop_within(std::chrono::milliseconds time) {
  thread_.request_stop();
  std::unique_lock lock(mutex_);
  return ordered_.wait_for(lock, time, [this] { return has_ended_; });
}

void EstimatorThread::give(Order order) {
  const std::scoped_lock lock(mutex_);
  if (order.kind == Order::Kind::abandon) is_abandoned_ = true;
  orders_.push_back(std::move(order));
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
    std::vector<Order> orders;
    std::stop_token interrupt;
    {
      const std::scoped_lock lock(mutex_);
      orders.swap(orders_);
      if (interrupt_.stop_requested() && !stop.stop_requested()) interrupt_ = {};
      interrupt = interrupt_.get_token();
    }
    ++turns_;
    for (Order& order : orders) obey(std::move(order), stop);
    if (cameras_ended_) {
      wait_for_order(stop);
    } else if (auto frame = next_frame(interrupt)) {
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

std::optional<FrameSightings> EstimatorThread::next_frame(std::stop_token interrupt) {
  is_waiting_ = true;
  auto frame = rig_.next(interrupt);
  is_waiting_ = false;
  return frame;
}

void EstimatorThread::wait_for_order(std::stop_token stop) {
  std::unique_lock lock(mutex_);
  is_waiting_ = true;
  ordered_.wait(lock, stop, [this] { return !orders_.empty(); });
  is_waiting_ = false;
}

void EstimatorThread::obey(Order order, std::stop_token stop) {
  switch (order.kind) {
    case Order::Kind::begin:
      return begin(order.session, stop);
    case Order::Kind::change:
      description_.target = order.target;
      pre_trigger_ = order.pre_trigger;
      return;
    case Order::Kind::abandon:
      search_.reset();
      is_abandoned_ = false;
      return;
    case Order::Kind::finish:
      if (!search_) return;
      finish_search(stop);
      break;
    case Order::Kind::solve:
      session_ = order.session;
      session_rig_ = std::move(order.rig);
      search_.emplace(session_rig_);
      fits_ = {};
      for (Track& flight : order.flights) search_->add_flight(std::move(flight));
      break;
  }
  calibrate_now(stop, true);
  search_.reset();
}

void EstimatorThread::begin(std::int64_t session, std::stop_token stop) {
  session_ = session;
  session_rig_ = description_;
  search_.emplace(session_rig_);
  fits_ = {};
  found_at_.reset();
  rested_at_ = HostTime::min();
  for (const FrameSightings& frame : std::exchange(remembered_, {}))
    if (frame.time >= newest_ - pre_trigger_) take(frame, stop);
  newest_ = {};
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
    post_flights(search_->add(*frame));
  }
  post_flights(search_->finish());
}

void EstimatorThread::post_flights(std::vector<Track> flights) {
  if (!flights.empty()) news_.post({.session = session_, .flights = std::move(flights)});
}

void EstimatorThread::remember(FrameSightings frame) {
  newest_ = std::max(newest_, frame.time);
  remembered_.push_back(std::move(frame));
  while (!remembered_.empty() && remembered_.front().time < newest_ - pre_trigger_)
    remembered_.pop_front();
}

void EstimatorThread::take(const FrameSightings& frame, std::stop_token stop) {
  std::vector<Track> flights = search_->add(frame);
  if (!flights.empty() && !found_at_) {
    found_at_ = frame.time;
    found_until_ = HostTime::min();
  }
  for (const Track& flight : flights)
    found_until_ = std::max(found_until_, flight.sightings.back().time);
  post_flights(std::move(flights));
  if (!found_at_ || frame.time < rested_at_) return;
  if (search_->is_following_since_before(found_until_) && frame.time < *found_at_ + longest_wait)
    return;
  found_at_.reset();
  const auto began = std::chrono::steady_clock::now();
  calibrate_now(stop, false);
  const auto work = std::chrono::steady_clock::now() - began;
  rested_at_ = frame.time + (1 + rest_per_work) * work;
}

void EstimatorThread::calibrate_now(std::stop_token stop, bool last) {
  const std::vector<Throw> throws = search_->throws();
  if (throws.empty() && !last) return;
  CalibrateSettings settings;
  settings.fits = &fits_;
  settings.progress = [&](double) {
    ++turns_;
    if (stop.stop_requested() || is_abandoned_) throw GivenUp{};
  };
  try {
    auto calibration =
        std::make_shared<const Calibration>(calibrate(session_rig_, throws, settings));
    news_.post({.session = session_,
                .throws = times_thrown(throws),
                .calibrated_flights = search_->flights(),
                .calibration = std::move(calibration),
                .solved = last});
  } catch (const GivenUp&) {
    // Its flights are stored: the next start solves them, if they are still wanted.
  }
}

}  // namespace throwcal
