// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <Eigen/Core>
#include <vector>

#include "estimator/rig_description.h"
#include "estimator/super_state.h"
#include "estimator/throw_set.h"

namespace throwcal {

/// A number for every sighting of every throw, in the order of the throws.
template <typename T>
using PerSighting = std::vector<std::vector<T>>;

/// Every sighting's residual at a solution and how its prediction depends on the ball, its camera
/// and drag, all in units of the claimed noise. Every parameter is one of these columns or a fixed
/// mixture of them, so no parameter layout is needed here.
struct Linearisation {
  static constexpr int position = 0;   ///< d predicted / d ball position at its moment (3)
  static constexpr int velocity = 3;   ///< d predicted / d ball velocity at the throw's epoch (3)
  static constexpr int rotation = 6;   ///< d predicted / d camera rotation, world axes (3)
  static constexpr int offset = 9;     ///< d predicted / d time offset
  static constexpr int drag = 10;      ///< d predicted / d drag
  static constexpr int residual = 11;  ///< measured minus predicted; NaN where it cannot be seen
  static constexpr int lens = 12;      ///< d predicted / d the lens numbers that are estimated
  static constexpr int plain_columns = 12;

  int columns = plain_columns;
  std::vector<Eigen::VectorXd> rows;  ///< of a throw: two rows a sighting, u's and v's

  const double* row(std::size_t j, std::size_t i) const {
    return rows[j].data() + 2 * static_cast<std::size_t>(columns) * i;
  }
  PerSighting<Eigen::Vector2d> residuals() const;
};

/// Into `out`, whose memory is used again.
void linearise(const RigDescription& rig, const std::vector<TimedThrow>& throws, const Solution& at,
               Linearisation& out);

/// Residuals alone, in units of the claimed noise; NaN where the ball cannot be seen.
PerSighting<Eigen::Vector2d> claimed_residuals(const RigDescription& rig,
                                               const std::vector<TimedThrow>& throws,
                                               const Solution& at);

}  // namespace throwcal
