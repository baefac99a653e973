// SPDX-License-Identifier: BSD-3-Clause
#include "capture/sighting_crops.h"

#include <algorithm>

namespace throwcal {
namespace {

constexpr std::size_t cell_bytes = std::size_t{SightingCrops::side} * SightingCrops::side;
constexpr double unknown_radius_px = 8.0;

}  // namespace

SightingCrops::SightingCrops(std::size_t bytes)
    : cells_(std::max<std::size_t>(1, bytes / cell_bytes)), memory_(cells_.size() * cell_bytes) {}

void SightingCrops::keep(const Frame& frame, const std::vector<BallSighting>& sightings) {
  const std::lock_guard lock(mutex_);
  for (std::size_t i = 0; i < std::min(sightings.size(), per_frame); ++i) {
    const BallSighting& s = sightings[i];
    const CropArea area = around(frame.image, s.center_px.x(), s.center_px.y(),
                                 s.radius_px.value_or(unknown_radius_px), side);
    cells_[next_] = {s.time, s.center_px, area};
    copy_brightness(frame.image, area, memory_.data() + next_ * cell_bytes);
    next_ = (next_ + 1) % cells_.size();
  }
}

std::optional<PictureCrop> SightingCrops::find(const BallSighting& sighting) const {
  const std::lock_guard lock(mutex_);
  const auto found = std::ranges::find_if(cells_, [&](const Cell& cell) {
    return cell.area.width > 0 && cell.time == sighting.time &&
           cell.center_px == sighting.center_px;
  });
  if (found == cells_.end()) return {};
  const std::uint8_t* from = memory_.data() + (found - cells_.begin()) * cell_bytes;
  return PictureCrop{
      found->area, found->time, {from, from + std::size_t(found->area.width) * found->area.height}};
}

}  // namespace throwcal
