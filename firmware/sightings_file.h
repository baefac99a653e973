// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "estimator/calibration.h"
#include "estimator/observation.h"
#include "estimator/rig_description.h"

namespace throwcal {

/// One row of a sightings file. Its id is the row's number, 1 for the first below the header.
struct SightingRow {
  BallSighting sighting;
  ThrowId throw_id;  ///< empty: which flight it belongs to is to be found
};

/// Reads a sightings file (CSV, see the contract): columns in any order, `radius_px`, `throw`,
/// `sigma_u_px,sigma_v_px[,correlation_uv]` and `partial` (0 or 1) optional, CRLF or LF. Times keep
/// their nanoseconds, seconds since 1970 included. A sighting's covariance is its own; where it has
/// none the rig's sigma_px, 1 px where the rig doesn't say either. Throws InputError:
/// `sightings.csv:7: u_px must be a number of pixels from -640 to 1280, got "12,5"`.
std::vector<SightingRow> read_sightings(const std::filesystem::path& file,
                                        const RigDescription& rig);
std::vector<SightingRow> parse_sightings(std::string_view csv, const std::string& name,
                                         const RigDescription& rig);

/// The labelled rows: a throw a label, a track a camera, all sorted by time, whatever the order of
/// the rows.
std::vector<Throw> labelled_throws(const std::vector<SightingRow>& rows);

/// The rows without a label, one entry a camera and frame time, ordered by time and camera.
std::vector<FrameSightings> unlabelled_frames(const std::vector<SightingRow>& rows);

/// The sightings file of some rows; `radius_px` and `throw` are left out where no row has them.
/// `with_errors`: also what the detector says of each: sigmas, correlation, and whether it is
/// partial.
std::string to_sightings_csv(const std::vector<SightingRow>& rows, const RigDescription& rig,
                             bool with_errors = false);

/// The residuals file: every sighting read, in its order, with what the calibration made of it. A
/// sighting of no throw has an empty throw and no residual.
std::string to_residuals_csv(const std::vector<BallSighting>& sightings,
                             const Calibration& calibration);

}  // namespace throwcal
