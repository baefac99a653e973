// SPDX-License-Identifier: BSD-3-Clause
#include "capture/frame_clock.h"

#include <algorithm>
#include <cmath>

namespace throwcal {
namespace {

using namespace std::chrono_literals;

/// Between a stamp and its dequeueing. Some drivers' stamps lie ahead by a frame: that is the same
/// for all frames, and a clock offset takes it up.
constexpr auto farthest = 2s;
constexpr double forget = 1.0 / 64;  ///< frames over which jitter and interval are averaged
constexpr auto least_sigma = 1us;    ///< a kernel's stamp of an interrupt is no better
/// Of a stamp whose jitter has not been measured yet.
constexpr auto first_sigma = 1ms;
constexpr std::uint64_t enough = 16;  ///< frames for a jitter

}  // namespace

FrameClock::FrameClock(double interval_s, double exposure_s, double readout_s)
    : interval_s_(interval_s), exposure_s_(exposure_s), readout_s_(readout_s) {}

FrameClock::Moment FrameClock::of(const DriverStamp& given) {
  const bool is_true = given.stamp && std::chrono::abs(*given.stamp - given.dequeued) <= farthest;
  const TimestampSource source = is_true ? given.source : TimestampSource::dequeue;
  HostTime time = is_true ? *given.stamp : given.dequeued;
  measure(time, given.sequence);
  if (!is_true) time = earliest(time, given.sequence);
  // What an unknown stamp names is unknown for all frames alike: a clock offset takes it up.
  const double behind_s = source == TimestampSource::start_of_exposure ? -0.5 * exposure_s_
                          : source == TimestampSource::unknown         ? 0.0
                                                               : readout_s_ + 0.5 * exposure_s_;
  const auto sigma = measured_ < enough ? std::chrono::nanoseconds(first_sigma)
                                        : from_seconds(std::sqrt(jitter_s2_));
  return {time - from_seconds(behind_s), std::max<std::chrono::nanoseconds>(sigma, least_sigma),
          source};
}

/// By how much steps between frames differ from the mean step: twice the variance of one stamp.
void FrameClock::measure(HostTime time, std::uint64_t sequence) {
  if (last_ && sequence > last_sequence_) {
    const double step_s = seconds(time - *last_) / static_cast<double>(sequence - last_sequence_);
    if (mean_interval_s_ == 0.0) mean_interval_s_ = interval_s_ > 0 ? interval_s_ : step_s;
    const double off_s = step_s - mean_interval_s_;
    const double weight = std::max(forget, 1.0 / static_cast<double>(++measured_));
    mean_interval_s_ += forget * off_s;
    jitter_s2_ += weight * (0.5 * off_s * off_s - jitter_s2_);
  }
  last_ = time;
  last_sequence_ = sequence;
}

/// The lower envelope of the last frames, at this one: how early it can have been, by how early the
/// others were and the interval between them.
HostTime FrameClock::earliest(HostTime dequeued, std::uint64_t sequence) {
  window_[taken_++ % window_.size()] = {dequeued, sequence};
  if (taken_ < window_.size()) return dequeued;
  const auto late_s = [&](const Taken& frame, double interval_s) {
    return seconds(frame.time - dequeued) +
           interval_s * static_cast<double>(sequence - frame.sequence);
  };
  // By how much the earliest of the older half is later than that of the newer half.
  double older_s = 1e9, newer_s = 1e9;
  const std::uint64_t middle =
      sequence - (sequence - window_[taken_ % window_.size()].sequence) / 2;
  for (const Taken& frame : window_)
    (frame.sequence < middle ? older_s : newer_s) =
        std::min(frame.sequence < middle ? older_s : newer_s, late_s(frame, mean_interval_s_));
  const double frames = static_cast<double>(sequence - middle);
  const double interval_s = mean_interval_s_ + (frames > 0 ? (newer_s - older_s) / frames : 0.0);
  double least_s = 0.0;
  for (const Taken& frame : window_) least_s = std::min(least_s, late_s(frame, interval_s));
  return dequeued + from_seconds(least_s);
}

}  // namespace throwcal
