// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <mutex>
#include <optional>
#include <vector>

#include "capture/picture_crop.h"

namespace throwcal {

/// What one camera's last sightings looked like, in memory that is taken once: the newest take the
/// place of the oldest. One thread keeps, any may find.
class SightingCrops {
 public:
  static constexpr int side = 48;              ///< of a crop, at most
  static constexpr std::size_t per_frame = 8;  ///< sightings of a frame that are kept

  explicit SightingCrops(std::size_t bytes);

  void keep(const Frame& frame, const std::vector<BallSighting>& sightings);
  /// Of this very sighting; nothing where it is gone.
  std::optional<PictureCrop> find(const BallSighting& sighting) const;

 private:
  struct Cell {
    HostTime time{};
    Eigen::Vector2d center_px = Eigen::Vector2d::Zero();
    CropArea area;
  };

  std::vector<Cell> cells_;
  std::vector<std::uint8_t> memory_;
  std::size_t next_ = 0;
  mutable std::mutex mutex_;
};

}  // namespace throwcal
