// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <memory>
#include <optional>
#include <string_view>
#include <vector>

#include "capture/colour.h"
#include "capture/frame.h"
#include "estimator/camera_model.h"
#include "estimator/observation.h"

namespace throwcal {

struct BallDetectorSettings {
  double threshold_sigmas = 5.0;  ///< of a pixel's own noise
  double min_radius_px = 1.2, max_radius_px = 60.0;
  int max_sightings = 16;                            ///< a frame; the most ball-like are kept
  std::optional<Colour> ball_colour = std::nullopt;  ///< makes use of a colour camera's chroma
};

/// 1-sigma of the error that all centres found in one camera share: measured on rendered footage of
/// matt balls, where whole recordings are off by 0.002 to 0.01 px.
constexpr double sigma_common_centre_px = 0.01;

/// What kept a detector from seeing, or nothing (`clear`).
enum class View { clear, learning, dark, saturated, shaken, wrong_size };
constexpr std::size_t views = 6;
/// As a person is told it: "too dark to see anything in".
std::string_view description(View view);

/// Finds ball-like moving blobs in one camera's frames: background difference, threshold,
/// components, then the fit of a shaded, moving sphere gives the sub-pixel centre of its
/// projection.
class BallDetector {
 public:
  BallDetector(CameraModel model, double ball_diameter_m, BallDetectorSettings settings = {});
  ~BallDetector();
  BallDetector(BallDetector&&) noexcept;

  /// Blobs in a frame, valid until the next call. Empty while the background is being learnt, and
  /// where the picture has not the size that the lens was calibrated for.
  const FrameSightings& detect(const Frame& frame);
  /// How the last frame looked.
  View view() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace throwcal
