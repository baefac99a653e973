// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/fit_memory.h"

#include <algorithm>
#include <bit>

namespace throwcal {
namespace {

/// Numbers, every bit of them, in 64 bits.
class Fingerprint {
 public:
  void add(std::uint64_t bits) {
    sum_ = (sum_ ^ bits) * 0x9E3779B97F4A7C15u;  // Knuth's multiplier
    sum_ ^= sum_ >> 32;
  }
  void add(double value) { add(std::bit_cast<std::uint64_t>(value)); }
  template <typename Derived>
  void add(const Eigen::DenseBase<Derived>& values) {
    for (Eigen::Index i = 0; i < values.size(); ++i) add(values.derived().coeff(i));
  }
  void add(const FlightFitSettings& s) {
    for (double value : {s.gravity_mps2, s.drag_per_m, s.sigma_drag_per_m, s.sigma_gravity_rad,
                         s.outlier_sigmas, s.max_relative_sigma_depth})
      add(value);
    add(std::uint64_t{s.noise_known} << 1 | std::uint64_t{s.search_outliers});
    if (s.gravity_cam_mps2) add(*s.gravity_cam_mps2);
  }
  std::uint64_t sum() const { return sum_; }

 private:
  std::uint64_t sum_ = 0;
};

const std::optional<CameraFlight> no_flight;

}  // namespace

template <typename Fit>
const std::optional<CameraFlight>& FitMemory::look_up(const Key& key, Fit fit) {
  auto known = known_.find(key);
  if (known == known_.end()) known = known_.emplace(key, Known{fit()}).first;
  known->second.is_used = true;
  return known->second.flight;
}

const std::optional<CameraFlight>& FitMemory::of(CameraId camera, HostTime epoch,
                                                 std::span<const TimedRay> rays,
                                                 const FlightFitSettings& settings) {
  if (rays.empty()) return no_flight;
  Fingerprint print;
  print.add(settings);
  for (const TimedRay& ray : rays) {
    print.add(ray.time_s);
    print.add(ray.direction_cam);
    print.add(ray.whitener.reshaped());
  }
  return look_up({camera, epoch, print.sum()},
                 [&] { return fit_flight(camera, epoch, rays, settings); });
}

const std::optional<CameraFlight>& FitMemory::of(const CameraModel& model, const Track& track,
                                                 const FlightFitSettings& settings) {
  if (track.sightings.empty()) return no_flight;
  Fingerprint print;
  print.add(settings);
  for (const BallSighting& s : track.sightings) {
    print.add(static_cast<std::uint64_t>(s.time.time_since_epoch().count()));
    print.add(s.center_px);
    print.add(s.cov_px2.reshaped());
  }
  return look_up({track.camera, track.sightings.front().time, print.sum()},
                 [&] { return fit_flight(model, track.sightings, settings); });
}

void FitMemory::forget_unused() {
  std::erase_if(known_, [](const auto& item) { return !item.second.is_used; });
  for (auto& [key, known] : known_) known.is_used = false;
}

std::size_t informants(std::size_t index, std::size_t flights) {
  constexpr std::size_t enough = 8;
  return std::min(flights, std::max(enough, std::bit_floor(index + 1)));
}

std::vector<std::optional<Eigen::Vector3d>> gravity_of_each(std::span<const CameraFlight> alone) {
  std::vector<std::optional<Eigen::Vector3d>> out;
  std::size_t told_by = 0;
  for (std::size_t i = 0; i < alone.size(); ++i) {
    const std::size_t count = informants(i, alone.size());
    out.push_back(count == told_by ? out.back() : mean_gravity(alone.first(count)));
    told_by = count;
  }
  return out;
}

std::vector<std::optional<CameraFlight>> fit_flights(const CameraModel& model,
                                                     std::span<const Track> tracks,
                                                     const FlightFitSettings& settings,
                                                     FitMemory& fits) {
  std::vector<CameraFlight> alone;
  std::vector<std::size_t> before;  // how many of these, at each track
  for (const Track& track : tracks) {
    before.push_back(alone.size());
    if (const auto& flight = fits.of(model, track, settings)) alone.push_back(*flight);
  }
  const std::vector<std::optional<Eigen::Vector3d>> gravity = gravity_of_each(alone);
  std::vector<std::optional<CameraFlight>> out;
  for (std::size_t j = 0; j < tracks.size(); ++j) {
    FlightFitSettings levelled = settings;
    if (!gravity.empty())
      levelled.gravity_cam_mps2 = gravity[std::min(before[j], gravity.size() - 1)];
    out.push_back(fits.of(model, tracks[j], levelled));
  }
  return out;
}

}  // namespace throwcal
