// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "estimator/flight_fit.h"
#include "estimator/observation.h"
#include "estimator/rig_description.h"

namespace throwcal {

/// A blob that may be the ball, as one camera's search for flights wants it.
struct Candidate {
  BallSighting sighting;
  TimedRay ray;                   ///< time relative to the history's epoch
  std::optional<double> range_m;  ///< from the apparent radius, where measured; good to 10-30 %
  bool taken = false;             ///< belongs to a flight that was reported
};

struct CandidateFrame {
  double time_s = 0.0;  ///< middle of the first row's exposure, relative to the history's epoch
  std::vector<Candidate> candidates;
};

/// One candidate in a history: frame by sequence number, so that it stays right as old frames go.
struct CandidateRef {
  std::int64_t frame = 0;
  std::size_t index = 0;
  auto operator<=>(const CandidateRef&) const = default;
};

/// The last minute of one camera's candidates, undistorted once.
class CandidateHistory {
 public:
  CandidateHistory(const CameraModel& model, double ball_diameter_m)
      : model_(model), ball_diameter_m_(ball_diameter_m) {}

  /// Appends a frame and lets the oldest go. A frame no later than the last is left out: false.
  bool add(const FrameSightings& frame);

  std::int64_t begin_frame() const { return first_; }
  std::int64_t end_frame() const { return first_ + static_cast<std::int64_t>(frames_.size()); }
  const CandidateFrame& frame(std::int64_t number) const {
    return frames_[static_cast<std::size_t>(number - first_)];
  }
  bool holds(const CandidateRef& ref) const {
    return ref.frame >= first_ && ref.frame < end_frame();
  }
  const Candidate& at(const CandidateRef& ref) const {
    return frame(ref.frame).candidates[ref.index];
  }
  void take(const CandidateRef& ref) {
    frames_[static_cast<std::size_t>(ref.frame - first_)].candidates[ref.index].taken = true;
  }
  HostTime epoch() const { return epoch_; }
  const CameraModel& model() const { return model_; }
  /// Typical time between frames [s].
  double frame_interval_s() const { return interval_s_; }

 private:
  CameraModel model_;
  double ball_diameter_m_;
  HostTime epoch_{};
  std::int64_t first_ = 0;
  std::deque<CandidateFrame> frames_;
  std::size_t candidate_count_ = 0;
  std::deque<double> recent_intervals_s_;
  double interval_s_ = 1.0 / 60.0;
};

/// Apparent radius [px] of a ball: that of the circle with the area of its image.
std::optional<double> apparent_radius_px(const CameraModel& model, const Eigen::Vector3d& point_cam,
                                         double ball_diameter_m);

}  // namespace throwcal
