// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <string>
#include <vector>

#include "estimator/calibration.h"
#include "estimator/refinement.h"

namespace throwcal {

struct Judgement {
  Verdict verdict = Verdict::rejected;
  std::vector<std::string> reasons;
};

/// Whether a calibration can be trusted, and if not, why, in a field worker's words. Contradiction
/// first (a wrong model's covariance means nothing), then what is not determined, then what is not
/// determined well enough.
Judgement judge(const RigDescription& rig, const std::vector<TimedThrow>& throws,
                const Refinement& refinement);

/// Upper quantile of the chi-square distribution by Wilson and Hilferty's cube root, for a standard
/// normal quantile.
double chi2_quantile(double degrees_of_freedom, double normal_quantile);

}  // namespace throwcal
