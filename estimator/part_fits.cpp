// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/part_fits.h"

#include <span>

namespace throwcal {

const std::optional<CameraFlight>& PartFits::of(const ThrowPart& part, std::size_t first,
                                                std::size_t count) {
  const std::span<const TimedRay> rays = std::span(part.rays).subspan(first, count);
  if (rays.empty()) {
    static const std::optional<CameraFlight> none;
    return none;
  }
  const Eigen::Vector3d gravity = part.settings.gravity_cam_mps2.value_or(Eigen::Vector3d::Zero());
  const Key key{part.track.camera,
                part.epoch,
                rays.front().time_s,
                rays.front().whitener.squaredNorm(),
                rays.back().time_s,
                rays.back().whitener.squaredNorm(),
                count,
                part.settings.noise_known,
                gravity.x(),
                gravity.y(),
                gravity.z(),
                part.settings.sigma_gravity_rad};
  auto known = known_.find(key);
  if (known == known_.end())
    known =
        known_.emplace(key, Known{fit_flight(part.track.camera, part.epoch, rays, part.settings)})
            .first;
  known->second.is_used = true;
  return known->second.flight;
}

void PartFits::forget_unused() {
  std::erase_if(known_, [](const auto& item) { return !item.second.is_used; });
  for (auto& [key, known] : known_) known.is_used = false;
}

}  // namespace throwcal
