// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "capture/ball_detector.h"
#include "capture/camera.h"
#include "capture/grabber.h"
#include "capture/picture_crop.h"
#include "estimator/observation.h"

namespace throwcal {

struct RigSettings {
  std::size_t ring_slots = 32;         ///< frames a camera's ring holds
  std::size_t crop_bytes = 4'000'000;  ///< of a camera's last sightings' pictures
  int queue_frames = 4096;  ///< frames' worth of sightings that may wait for the estimator
  double ball_diameter_m = 0.0657;
  BallDetectorSettings detector{};
};

/// Counters of one camera since start. `running`: its detector is at work, and nothing keeps frames
/// from coming.
struct CameraStats : GrabberStats {
  std::string name;
  std::uint64_t frames = 0;     ///< processed by the detector
  std::uint64_t sightings = 0;  ///< candidates found
  View view = View::learning;   ///< how the last frame looked
  std::array<std::uint64_t, views> frames_by_view{};
  TimestampSource timestamp_source = TimestampSource::unknown;  ///< of the last frame
  double time_sigma_s = 0.0;                                    ///< likewise
  double frames_per_s = 0.0;                                    ///< over the last second or so
  CameraIdentity identity;
  PictureSettings settings;
};

/// The deep face of capture/: owns the cameras, their rings, detectors and threads (one a camera,
/// named after it).
class Rig {
 public:
  Rig(std::vector<std::unique_ptr<Camera>> cameras, const RigSettings& settings);
  ~Rig();  ///< stops

  void start();
  /// The next frame's sightings of any camera, those of one camera in order of time; waits for it.
  /// Nothing when `stop` is requested, or when every camera has ended and all has been handed out.
  std::optional<FrameSightings> next(std::stop_token stop);
  void stop();
  /// A camera's newest frame, by reference: holding it takes its slot from the ring. Thread-safe.
  std::optional<FrameLease> newest(CameraId camera);
  /// What a sighting looked like; nothing where that is gone. Thread-safe.
  std::optional<PictureCrop> crop_of(const BallSighting& sighting) const;
  /// What was found in the last frame that a camera's detector has seen; no time before the first.
  /// Thread-safe.
  FrameSightings last_sightings(CameraId camera) const;
  std::vector<CameraStats> stats() const;  ///< thread-safe
  std::uint64_t sightings_dropped()
      const;  ///< frames' worth of sightings lost because the queue was full

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace throwcal
