// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/verdict.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

#include "estimator/elementary.h"
#include "estimator/observability.h"

namespace throwcal {
namespace {

constexpr double misfit_normal_quantile = 4.753;  // one false alarm in a million
constexpr double max_gated_of_camera = 0.15;
constexpr int min_gated_of_camera = 12;
constexpr double max_smooth_share = 0.6, max_smooth_px = 0.5;

template <typename... Values>
std::string text(const char* format, Values... values) {
  char buffer[400];
  std::snprintf(buffer, sizeof buffer, format, values...);
  return buffer;
}

/// Sums over one camera's sightings.
struct CameraFit {
  double chi2 = 0.0, products = 0.0, squares_of_pairs = 0.0, squares_px = 0.0;
  int used = 0, gated = 0, pairs = 0;
};

std::vector<CameraFit> fit_of_cameras(const RigDescription& rig,
                                      const std::vector<TimedThrow>& throws, const Refinement& at) {
  std::vector<CameraFit> out(rig.cameras.size());
  for (std::size_t j = 0; j < throws.size(); ++j) {
    std::vector<const Eigen::Vector2d*> before(rig.cameras.size(), nullptr);
    for (std::size_t i = 0; i < throws[j].sightings.size(); ++i) {
      const TimedSighting& s = throws[j].sightings[i];
      CameraFit& camera = out[s.camera];
      if (!at.weighting.used[j][i]) {
        ++camera.gated;
        continue;
      }
      const Eigen::Vector2d& r = at.residuals[j][i];
      ++camera.used;
      camera.chi2 += r.squaredNorm() / square(at.weighting.noise_scale[s.camera]);
      camera.squares_px += (s.whitening.inverse() * r).squaredNorm();
      if (const auto* last = std::exchange(before[s.camera], &r)) {
        camera.products += last->dot(r),
            camera.squares_of_pairs += 0.5 * (last->squaredNorm() + r.squaredNorm());
        ++camera.pairs;
      }
    }
  }
  return out;
}

std::string worst_camera(const RigDescription& rig, const std::vector<CameraFit>& fits) {
  std::size_t worst = 0;
  const auto misfit = [&](std::size_t k) {
    return fits[k].used ? fits[k].chi2 / (2 * fits[k].used) : 0.0;
  };
  for (std::size_t k = 1; k < fits.size(); ++k)
    if (misfit(k) > misfit(worst)) worst = k;
  return text("it is worst in camera %s, %.1f times its stated noise",
              rig.cameras[worst].name.c_str(), std::sqrt(misfit(worst)));
}

/// What the residuals say against the model. Stated noise gives chi-square an absolute scale;
/// without it, residuals that follow each other smoothly betray a wrong model, for centroid noise
/// has no memory.
std::vector<std::string> contradictions(const RigDescription& rig, const Refinement& at,
                                        const std::vector<CameraFit>& fits) {
  constexpr const char* causes =
      "check the lens parameters, the ball, that no camera was moved and that none is mixed up";
  std::vector<std::string> out;
  const bool all_stated = std::all_of(rig.cameras.begin(), rig.cameras.end(),
                                      [](const auto& c) { return c.sigma_px.has_value(); });
  if (all_stated && at.degrees_of_freedom > 0 &&
      at.chi2 > chi2_quantile(at.degrees_of_freedom, misfit_normal_quantile))
    out.push_back(
        text("the sightings contradict the model: the residuals are %.2f times what the stated "
             "noise allows (%s); %s",
             std::sqrt(at.chi2 / at.degrees_of_freedom), worst_camera(rig, fits).c_str(), causes));
  for (std::size_t k = 0; k < fits.size(); ++k) {
    const CameraFit& f = fits[k];
    const char* name = rig.cameras[k].name.c_str();
    if (at.solution.rig.is_placed[k] && f.gated >= min_gated_of_camera &&
        f.gated > max_gated_of_camera * (f.gated + f.used))
      out.push_back(text("camera %s: %d of %d sightings fit no common flight; %s", name, f.gated,
                         f.gated + f.used, causes));
    if (rig.cameras[k].sigma_px || f.pairs < 30 || !(f.squares_of_pairs > 0)) continue;
    const double share = f.products / f.squares_of_pairs,
                 rms_px = std::sqrt(f.squares_px / (2 * f.used));
    if (share > max_smooth_share && std::sqrt(share) * rms_px > max_smooth_px)
      out.push_back(
          text("camera %s: the residuals (%.2f px) are no noise, they follow each other from frame "
               "to frame; %s",
               name, rms_px, causes));
  }
  return out;
}

std::vector<std::string> short_of_target(const RigDescription& rig, const Refinement& at) {
  std::vector<std::string> out;
  for (std::size_t k = 0; k < rig.cameras.size(); ++k) {
    const Eigen::Matrix<double, 6, 1> variance =
        at.layout.pose_covariance(k, at.solution.rig, at.covariance).diagonal();
    const double position_m = std::sqrt(variance.head<3>().sum());
    const double rotation_rad = std::sqrt(variance.tail<3>().sum());
    if (position_m > rig.target.position_m || rotation_rad > rig.target.rotation_rad)
      out.push_back(
          text("camera %s is known to %.1f mm and %.2f mrad; wanted are %.1f mm and %.2f mrad: "
               "throw more, where it sees the ball",
               rig.cameras[k].name.c_str(), 1e3 * position_m, 1e3 * rotation_rad,
               1e3 * rig.target.position_m, 1e3 * rig.target.rotation_rad));
  }
  return out;
}

}  // namespace

double chi2_quantile(double degrees_of_freedom, double normal_quantile) {
  const double spread = 2.0 / (9.0 * degrees_of_freedom);
  const double root = 1.0 - spread + normal_quantile * std::sqrt(spread);
  return degrees_of_freedom * root * root * root;
}

Judgement judge(const RigDescription& rig, const std::vector<TimedThrow>& throws,
                const Refinement& refinement) {
  const auto fits = fit_of_cameras(rig, throws, refinement);
  if (auto reasons = contradictions(rig, refinement, fits); !reasons.empty())
    return {Verdict::rejected, reasons};
  if (auto reasons = undetermined(rig, throws, refinement); !reasons.empty())
    return {Verdict::unobservable, reasons};
  if (auto reasons = short_of_target(rig, refinement); !reasons.empty())
    return {Verdict::needs_more_throws, reasons};
  return {Verdict::accepted, {}};
}

}  // namespace throwcal
