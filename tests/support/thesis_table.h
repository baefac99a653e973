// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include "tests/support/thesis_errors.h"

namespace throwcal::test {

/// One experiment, the thesis beside ours.
struct ThesisComparison {
  ThesisExperiment experiment;
  ThesisErrors thesis;
  ThesisErrors filter;  ///< ours of the same name, from the thesis' guess
  ThesisFull full;      ///< without any guess; of no use for a drop
  ThesisBounds bounds;
  std::array<double, 2> noise_px{};  ///< re-projection error of the truth itself
};

/// Runs both on 20 recordings (seeds 1 to 20) and prints the experiment's part of the table.
ThesisComparison compare(const ThesisExperiment& experiment, const ThesisFilter& filter,
                         const ThesisResult& thesis);

/// Expects both methods' angle and centre errors to be at most the thesis', of a drop those that it
/// determines.
void expect_poses_not_above_thesis(const ThesisComparison& comparison);

/// Expects the re-projection errors of the full method (of a drop, the filter's) to be at most the
/// thesis', or at least below what the noise alone makes: the thesis had one recording's luck.
void expect_reprojection_not_above_thesis(const ThesisComparison& comparison);

/// Expects both methods' RMS errors to be what least squares promises. Over 20 recordings their
/// mean square has a relative sigma of at most sqrt(2 / 20), when all the error lies in one
/// direction; at 3 sigma the RMS is 1.4 times the promise.
void expect_least_squares(const ThesisComparison& comparison);

}  // namespace throwcal::test
