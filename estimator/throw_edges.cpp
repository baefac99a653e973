// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/throw_edges.h"

#include <algorithm>
#include <cmath>
#include <optional>

namespace throwcal {
namespace {

constexpr int max_cut_frames = 5, rounds = 2;
constexpr double excess_sigmas = 2.5;
constexpr std::size_t min_left = 8;
constexpr double clear_frames = 4.5;  ///< as far from the edge what a camera saw beyond counts

/// Throw's clock, seconds after an arbitrary but common origin.
double time_of(const ThrowPart& part, std::size_t i, HostTime origin) {
  return seconds(part.epoch - origin) + part.rays[i].time_s + part.offset_s;
}

/// First (or last) moment at which any camera saw the throw.
double edge_time(const std::vector<ThrowPart>& parts, HostTime origin, bool front) {
  double out = front ? 1e300 : -1e300;
  for (const ThrowPart& part : parts) {
    const double t = time_of(part, front ? 0 : part.rays.size() - 1, origin);
    out = front ? std::min(out, t) : std::max(out, t);
  }
  return out;
}

/// How many of a part's sightings lie before (or after) a moment.
std::size_t count_beyond(const ThrowPart& part, HostTime origin, double moment_s, bool front) {
  std::size_t n = 0;
  for (std::size_t i = 0; i < part.rays.size(); ++i) {
    const double t = time_of(part, i, origin);
    if (front ? t < moment_s : t > moment_s) ++n;
  }
  return n;
}

const std::optional<CameraFlight>& fit(FitMemory& fits, const ThrowPart& part, std::size_t skip,
                                       bool front) {
  return fit_of(part, front ? skip : 0, part.rays.size() - skip, fits);
}

void drop(ThrowPart& part, std::size_t count, bool front) {
  const auto n = static_cast<std::ptrdiff_t>(count);
  auto& sightings = part.track.sightings;
  if (front) {
    sightings.erase(sightings.begin(), sightings.begin() + n);
    part.rays.erase(part.rays.begin(), part.rays.begin() + n);
  } else {
    sightings.erase(sightings.end() - n, sightings.end());
    part.rays.erase(part.rays.end() - n, part.rays.end());
  }
}

/// By how many sigmas what lies beyond a moment costs more than chance, over all cameras.
double excess(const std::vector<ThrowPart>& parts, FitMemory& fits, HostTime origin,
              double moment_s, bool front) {
  double cost = 0.0, freedom = 0.0;
  for (const ThrowPart& part : parts) {
    const std::size_t n = count_beyond(part, origin, moment_s, front);
    if (n == 0 || part.rays.size() < min_left + n) continue;
    const auto &with = fit(fits, part, 0, front), &without = fit(fits, part, n, front);
    if (!with || !without) continue;
    // An edge sighting that the fit already left out as an outlier costs what an outlier may.
    cost += with->chi2 - without->chi2;
    const double used = 0.5 * (with->dof - without->dof);
    cost += 16.0 * (static_cast<double>(n) - used);
    freedom += 2.0 * static_cast<double>(n);
  }
  return freedom > 0 ? (cost - freedom) / std::sqrt(2.0 * freedom) : 0.0;
}

/// True where anything was cut.
bool cut(std::vector<ThrowPart>& parts, FitMemory& fits, HostTime origin, double frame_s,
         bool front) {
  bool has_cut = false;
  for (int round = 0; round < rounds; ++round) {
    const double edge_s = edge_time(parts, origin, front);
    double worst = excess_sigmas, moment_s = 0.0;
    for (int k = 1; k <= max_cut_frames; ++k) {
      const double m = front ? edge_s + (k - 0.5) * frame_s : edge_s - (k - 0.5) * frame_s;
      const double z = excess(parts, fits, origin, m, front);
      if (z <= worst) continue;
      worst = z;
      moment_s = m;
    }
    if (worst == excess_sigmas) return has_cut;
    has_cut = true;
    for (ThrowPart& part : parts) {
      const std::size_t n = count_beyond(part, origin, moment_s, front);
      if (n > 0 && part.rays.size() >= min_left + n) drop(part, n, front);
    }
  }
  return has_cut;
}

/// Whether no camera that saw the edge saw anything beyond it.
bool is_clear(const std::vector<ThrowPart>& parts, HostTime origin, double frame_s, bool front) {
  const double edge_s = edge_time(parts, origin, front);
  return std::ranges::all_of(parts, [&](const ThrowPart& part) {
    const double own_s = time_of(part, front ? 0 : part.rays.size() - 1, origin);
    return (front ? part.track.begins_clear : part.track.ends_clear) ||
           std::abs(own_s - edge_s) > clear_frames * frame_s;
  });
}

/// The outermost frame cannot be told from its neighbour on the other side of the edge.
void guard(std::vector<ThrowPart>& parts, HostTime origin, double frame_s, bool front) {
  const double edge_s = edge_time(parts, origin, front);
  const double moment_s = front ? edge_s + 0.75 * frame_s : edge_s - 0.75 * frame_s;
  for (ThrowPart& part : parts) {
    const std::size_t n = count_beyond(part, origin, moment_s, front);
    if (n > 0 && part.rays.size() > min_left + n) drop(part, n, front);
  }
}

/// What is not seen whole at an edge is seen before the hand: it says little, and whether it flies
/// already, nothing.
void drop_partial(ThrowPart& part, bool front) {
  const auto& sightings = part.track.sightings;
  const auto is_whole = [](const BallSighting& s) { return !s.is_partial; };
  const auto n =
      front ? std::ranges::find_if(sightings, is_whole) - sightings.begin()
            : std::find_if(sightings.rbegin(), sightings.rend(), is_whole) - sightings.rbegin();
  const auto count = static_cast<std::size_t>(n);
  if (count > 0 && part.rays.size() > min_left + count) drop(part, count, front);
}

}  // namespace

void cut_edges(std::vector<ThrowPart>& parts, FitMemory& fits) {
  if (parts.empty()) return;
  const HostTime origin = parts.front().epoch;
  double frame_s = 0.0;
  for (const ThrowPart& part : parts) frame_s = std::max(frame_s, part.frame_interval_s);
  for (const bool front : {true, false}) {
    for (ThrowPart& part : parts) drop_partial(part, front);
    const bool clear = is_clear(parts, origin, frame_s, front);
    if (cut(parts, fits, origin, frame_s, front) || !clear) guard(parts, origin, frame_s, front);
  }
}

}  // namespace throwcal
