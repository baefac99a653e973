// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/throw_assembler.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <span>
#include <utility>

#include "estimator/camera_matching.h"
#include "estimator/camera_tree.h"
#include "estimator/throw_edges.h"

namespace throwcal {
namespace {

constexpr double unknown_drag_per_m = 0.02, sigma_unknown_drag_per_m = 0.08;
constexpr double sigma_gravity_rad = 0.0035;  // of the mean over a camera's flights
constexpr double slow_error_px = 0.1;         // beside the noise, where the rig states none
constexpr double max_piece_gap_s = 0.15, max_joined_chi2_per_dof = 2.0;
constexpr double max_chi2_per_dof = 3.0;
// What the tree's alignments do not say of their own errors: heading, position, offset.
constexpr double tree_sigma_rad = 0.004, tree_sigma_m = 0.02, tree_sigma_s = 0.0005;

/// One camera's tracks and what they are as flights.
struct CameraView {
  std::vector<ThrowPart> parts;
  std::vector<CameraFlight> flights;  ///< one a part
};

FlightFitSettings settings_for(const RigDescription& rig) {
  FlightFitSettings out;
  out.gravity_mps2 = rig.gravity_mps2;
  out.drag_per_m = rig.ball.drag_per_m;
  if (rig.ball.estimate_drag) {
    if (out.drag_per_m <= 0) out.drag_per_m = unknown_drag_per_m;
    out.sigma_drag_per_m = sigma_unknown_drag_per_m;
  }
  return out;
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

ThrowPart as_part(const CameraModel& model, const Track& track, const FlightFitSettings& settings) {
  ThrowPart out{.track = {track.camera, {}, track.begins_clear, track.ends_clear},
                .rays = {},
                .epoch = {},
                .settings = settings};
  if (!track.sightings.empty()) out.epoch = track.sightings.front().time;
  std::vector<double> intervals_s;
  for (const BallSighting& sighting : track.sightings) {
    const auto ray = timed_ray(model, sighting, out.epoch);
    if (!ray) continue;
    if (!out.rays.empty())
      intervals_s.push_back(seconds(sighting.time - out.track.sightings.back().time));
    out.track.sightings.push_back(sighting);
    out.rays.push_back(*ray);
  }
  if (!intervals_s.empty()) out.frame_interval_s = median(intervals_s);
  return out;
}

/// Where the rig states no noise, a camera's flights tell it together.
void correct_noise(std::vector<ThrowPart>& parts, FitMemory& fits) {
  std::vector<double> scales;
  for (ThrowPart& part : parts) {
    part.settings.noise_known = false;
    if (const auto& flight = fit_of(part, fits)) scales.push_back(flight->noise_scale);
    part.settings.noise_known = true;
  }
  if (scales.empty()) return;
  for (std::size_t k = 0; k < parts.size(); ++k) {
    const auto end = static_cast<std::ptrdiff_t>(informants(k, scales.size()));
    ThrowPart& part = parts[k];
    const double scale = median({scales.begin(), scales.begin() + end});
    for (std::size_t i = 0; i < part.rays.size(); ++i) {
      const double var_px2 = 0.5 * part.track.sightings[i].cov_px2.trace();
      part.rays[i].whitener /= std::sqrt(scale * scale + slow_error_px * slow_error_px / var_px2);
    }
  }
}

/// Tracks that are pieces of one flight become one.
void join_pieces(std::vector<ThrowPart>& parts, FitMemory& fits) {
  for (std::size_t i = 0; i + 1 < parts.size();) {
    const ThrowPart &a = parts[i], &b = parts[i + 1];
    const double gap_s = seconds(b.track.sightings.front().time - a.track.sightings.back().time);
    if (!(gap_s > 0 && gap_s < max_piece_gap_s)) {
      ++i;
      continue;
    }
    ThrowPart whole = a;
    whole.track.sightings.insert(whole.track.sightings.end(), b.track.sightings.begin(),
                                 b.track.sightings.end());
    whole.track.ends_clear = b.track.ends_clear;
    for (TimedRay ray : b.rays) {
      ray.time_s += seconds(b.epoch - a.epoch);
      whole.rays.push_back(ray);
    }
    const auto& flight = fit_of(whole, fits);
    const auto kept = flight ? std::count(flight->used.begin(), flight->used.end(), true) : 0;
    if (!flight || flight->chi2 > max_joined_chi2_per_dof * flight->dof ||
        10 * kept < 9 * std::ssize(whole.rays)) {
      ++i;
      continue;
    }
    parts[i] = std::move(whole);
    parts.erase(parts.begin() + static_cast<std::ptrdiff_t>(i) + 1);
  }
}

/// Whether a track is a flight by the camera's own noise: one that holds a stroke or a bounce, or
/// whose sightings are mostly outliers, would only mislead.
bool is_clean(const CameraFlight& flight) {
  const auto kept = std::count(flight.used.begin(), flight.used.end(), true);
  return flight.chi2 < max_chi2_per_dof * flight.dof && 10 * kept >= 7 * std::ssize(flight.used);
}

/// Fits all tracks of a camera: each alone, then with the gravity that they agree on.
CameraView view_of(const RigDescription& rig, CameraId camera, const std::vector<ThrowPart>& all,
                   FitMemory& fits) {
  CameraView out;
  std::vector<ThrowPart> parts;
  std::ranges::copy_if(all, std::back_inserter(parts),
                       [&](const ThrowPart& part) { return part.track.camera == camera; });
  if (!rig.cameras[camera].sigma_px) correct_noise(parts, fits);
  join_pieces(parts, fits);
  std::vector<CameraFlight> alone;
  std::erase_if(parts, [&](const ThrowPart& part) {
    const auto& flight = fit_of(part, fits);
    const bool good = flight && is_clean(*flight);
    if (good) alone.push_back(*flight);
    return !good;
  });
  const auto gravity = gravity_of_each(alone);
  for (std::size_t i = 0; i < parts.size(); ++i) {
    ThrowPart& part = parts[i];
    part.settings.gravity_cam_mps2 = gravity[i];
    const auto& flight = fit_of(part, fits);
    if (!flight) continue;
    part.settings.sigma_gravity_rad = sigma_gravity_rad;  // from here on, ends are judged
    out.flights.push_back(*flight);
    out.parts.push_back(std::move(part));
  }
  return out;
}

CameraTree join_cameras(const std::vector<CameraView>& views, const AlignmentSettings& settings) {
  std::map<std::pair<CameraId, CameraId>, CameraMatch> matches;
  for (CameraId a = 0; a < views.size(); ++a)
    for (CameraId b = a + 1; b < views.size(); ++b)
      if (auto match = match_cameras(views[a].flights, views[b].flights, settings))
        matches.emplace(std::pair(a, b), *std::move(match));
  return CameraTree(views.size(), matches);
}

struct FlightRef {
  CameraId camera = 0;
  std::size_t index = 0;
};

/// Two flights of two cameras that agree under the rig that the tree makes.
struct Agreement {
  double chi2 = 0.0;
  std::size_t first = 0, second = 0;  ///< into the list of all flights
};

std::vector<Agreement> agreements(const std::vector<CameraView>& views, const CameraTree& tree,
                                  const std::vector<FlightRef>& all,
                                  const AlignmentSettings& settings) {
  std::vector<Agreement> out;
  for (std::size_t p = 0; p < all.size(); ++p)
    for (std::size_t q = p + 1; q < all.size(); ++q) {
      if (all[p].camera == all[q].camera) continue;
      auto alignment = tree.between(all[p].camera, all[q].camera);
      if (!alignment) continue;
      const CameraFlight& a = views[all[p].camera].flights[all[p].index];
      const CameraFlight& b = views[all[q].camera].flights[all[q].index];
      const double shift_s = seconds(b.epoch - a.epoch) + alignment->offset_b_minus_a_s;
      if (a.first_s > b.last_s + shift_s || b.first_s + shift_s > a.last_s) continue;
      alignment->slack_rad = settings.slack_rad;
      alignment->slack_mps = settings.slack_mps;
      alignment->covariance.diagonal() +=
          Eigen::Matrix<double, 5, 1>(tree_sigma_rad, tree_sigma_m, tree_sigma_m, tree_sigma_m,
                                      tree_sigma_s)
              .cwiseAbs2();
      const double chi2 = mismatch_chi2(*alignment, a, b);
      if (chi2 < settings.gate_chi2) out.push_back({chi2, p, q});
    }
  std::stable_sort(out.begin(), out.end(),
                   [](const Agreement& a, const Agreement& b) { return a.chi2 < b.chi2; });
  return out;
}

/// Groups of flights, best agreement first, at most one flight a camera in each.
std::vector<std::vector<std::size_t>> group(const std::vector<FlightRef>& all,
                                            const std::vector<Agreement>& agreements) {
  std::vector<std::vector<std::size_t>> groups;
  std::vector<std::size_t> group_of(all.size());
  for (std::size_t i = 0; i < all.size(); ++i) {
    groups.push_back({i});
    group_of[i] = i;
  }
  for (const Agreement& agreement : agreements) {
    const std::size_t into = group_of[agreement.first], from = group_of[agreement.second];
    if (into == from) continue;
    const bool clash = std::any_of(groups[into].begin(), groups[into].end(), [&](std::size_t i) {
      return std::any_of(groups[from].begin(), groups[from].end(),
                         [&](std::size_t j) { return all[i].camera == all[j].camera; });
    });
    if (clash) continue;
    for (const std::size_t j : std::exchange(groups[from], {})) {
      groups[into].push_back(j);
      group_of[j] = into;
    }
  }
  std::erase_if(groups, [](const auto& g) { return g.size() < 2; });
  return groups;
}

/// Which flights are one, and the rough rig under which they are.
struct Assembly {
  CameraTree tree;
  std::vector<std::vector<std::size_t>> groups;  ///< into the list of all flights
  std::size_t flights = 0;                       ///< in the groups
};

Assembly assemble_with(const std::vector<CameraView>& views, const std::vector<FlightRef>& all,
                       const AlignmentSettings& settings) {
  Assembly out{join_cameras(views, settings), {}};
  out.groups = group(all, agreements(views, out.tree, all, settings));
  for (const auto& members : out.groups) out.flights += members.size();
  return out;
}

/// Strict first. Where that leaves most of what flew unexplained, spin or an odd drag may bend the
/// flights, or gravity rests on few of them: then again with ten times the slack, if that explains
/// at least twice as many.
Assembly assemble_flights(const std::vector<CameraView>& views, const std::vector<FlightRef>& all,
                          const AlignmentSettings& strict) {
  Assembly out = assemble_with(views, all, strict);
  if (3 * out.flights >= all.size()) return out;
  AlignmentSettings loose = strict;
  loose.slack_rad *= 10;
  loose.slack_mps *= 10;
  Assembly wider = assemble_with(views, all, loose);
  return wider.flights >= 2 * out.flights ? wider : out;
}

Throw as_throw(std::vector<ThrowPart> parts, FitMemory& fits) {
  cut_edges(parts, fits);
  Throw out;
  for (ThrowPart& part : parts) out.tracks.push_back(std::move(part.track));
  std::stable_sort(out.tracks.begin(), out.tracks.end(),
                   [](const Track& a, const Track& b) { return a.camera < b.camera; });
  return out;
}

}  // namespace

ThrowAssembler::ThrowAssembler(const RigDescription& rig, ThrowAssemblerSettings settings)
    : rig_(rig), settings_(settings) {}

void ThrowAssembler::add(const Track& track) {
  ThrowPart part = as_part(rig_.cameras.at(track.camera).model, track, settings_for(rig_));
  if (!part.rays.empty()) parts_.push_back(std::move(part));
}

std::vector<Throw> ThrowAssembler::assemble() {
  std::ranges::stable_sort(
      parts_, {}, [](const ThrowPart& part) { return std::pair(part.epoch, part.track.camera); });
  std::vector<CameraView> views;
  for (CameraId camera = 0; camera < rig_.cameras.size(); ++camera)
    views.push_back(view_of(rig_, camera, parts_, fits_));
  const AlignmentSettings strict{.estimate_offset = rig_.estimate_offsets,
                                 .max_offset_s = settings_.max_offset_s};

  std::vector<FlightRef> all;
  for (CameraId camera = 0; camera < views.size(); ++camera)
    for (std::size_t i = 0; i < views[camera].flights.size(); ++i) all.push_back({camera, i});
  const Assembly assembly = assemble_flights(views, all, strict);
  std::vector<std::pair<double, Throw>> timed;
  for (const auto& members : assembly.groups) {
    std::vector<ThrowPart> parts;
    for (const std::size_t i : members) {
      parts.push_back(views[all[i].camera].parts[all[i].index]);
      parts.back().offset_s = assembly.tree.offset_s(all[i].camera);
    }
    const double start_s = seconds(parts.front().epoch.time_since_epoch()) + parts.front().offset_s;
    timed.emplace_back(start_s, as_throw(std::move(parts), fits_));
  }
  std::stable_sort(timed.begin(), timed.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<Throw> out;
  for (auto& [start_s, thrown] : timed) {
    thrown.id = std::to_string(out.size() + 1);
    out.push_back(std::move(thrown));
  }
  fits_.forget_unused();
  return out;
}

}  // namespace throwcal
