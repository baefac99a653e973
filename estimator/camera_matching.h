// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "estimator/flight_alignment.h"

namespace throwcal {

/// Which flights two cameras share, and the relative pose that follows.
struct CameraMatch {
  CameraAlignment alignment;
  /// Index of a's flight and of b's, one to one.
  std::vector<std::pair<std::size_t, std::size_t>> pairs;
  double score = 0.0;  ///< grows with every pair, the more the better it fits
};

/// Finds the flights that two cameras share though neither pose nor clock is known: any two that
/// agree in apex, horizontal speed and time are a hypothesis of where the cameras stand, and the
/// hypothesis that most flights obey wins. Nothing where none is convincing.
std::optional<CameraMatch> match_cameras(std::span<const CameraFlight> a,
                                         std::span<const CameraFlight> b,
                                         const AlignmentSettings& settings);

}  // namespace throwcal
