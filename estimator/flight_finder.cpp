// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/flight_finder.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "estimator/candidate_linker.h"
#include "estimator/elementary.h"
#include "estimator/flight_growth.h"
#include "estimator/noise_estimate.h"

namespace throwcal {
namespace {

constexpr double tick_s = 0.05;            // how often the stream is searched
constexpr double slow_interval_s = 0.025;  // slower cameras get longer windows
constexpr double over_s = 0.12;            // unseen for so long, a flight is over
constexpr std::int64_t over_frames = 5;
constexpr double max_pause_s = 0.3;  // whatever the number of frames
constexpr std::size_t remembered_flights = 40, agreeing_flights = 3;
constexpr double min_sigma_gravity_rad = 0.0035;  // 0.2 degrees: the agreement's own error
constexpr double max_sigma_gravity_rad = 0.02;
constexpr double unknown_drag_per_m = 0.02, sigma_unknown_drag_per_m = 0.08;
constexpr double min_sigma_drag_per_m = 0.004;
constexpr double slow_error_px = 0.1;      // of a detector whose noise nobody states
constexpr double max_noise_scale = 4.0;    // of a noise that the rig states
constexpr double min_seen_fraction = 0.4;  // of the frames between a flight's ends

}  // namespace

struct FlightFinder::State {
  FlightFinderSettings settings;
  bool noise_stated = false, estimate_drag = false;
  double start_drag_per_m = 0.0;
  CandidateHistory history;
  CandidateLinker linker;
  NoiseEstimate noise;
  FlightKnowledge knowledge;
  std::vector<CameraFlight> flights;  // what the newest flights told
  std::vector<GrownFlight> open;
  std::vector<Tracklet> archive;  // ended tracklets, for a second look once gravity is known
  double next_tick_s = -1e300;

  State(const RigDescription& rig, CameraId camera, FlightFinderSettings s)
      : settings(s),
        noise_stated(rig.cameras[camera].sigma_px.has_value()),
        estimate_drag(rig.ball.estimate_drag),
        history(rig.cameras[camera].model, rig.ball.diameter_m) {
    knowledge.gravity_mps2 = rig.gravity_mps2;
    start_drag_per_m = rig.ball.drag_per_m;
    if (estimate_drag && start_drag_per_m <= 0) start_drag_per_m = unknown_drag_per_m;
    if (!noise_stated) knowledge.slow_error_px = slow_error_px;
    knowledge.drag_per_m = start_drag_per_m;
    knowledge.sigma_drag_per_m = estimate_drag ? sigma_unknown_drag_per_m : 0.0;
  }

  /// Whether the stream paused for so long that whatever flew before is over.
  bool pauses_before(const FrameSightings& frame) const {
    if (history.begin_frame() == history.end_frame()) return false;
    const double time_s = seconds(frame.time - history.epoch());
    return time_s - history.frame(history.end_frame() - 1).time_s > max_pause_s;
  }

  /// False while the noise is unknown: then nothing can be tested.
  bool learn_noise() {
    for (Tracklet& tracklet : linker.live()) noise.add(history, tracklet);
    for (Tracklet& tracklet : archive) noise.add(history, tracklet);
    const auto scale = noise.scale();
    if (noise_stated)  // a stated noise may be too small for this light, never too large by design
      knowledge.noise_scale = std::clamp(scale.value_or(1.0), 1.0, max_noise_scale);
    else if (scale)
      knowledge.noise_scale = std::max(*scale, 1e-3);
    return noise_stated || scale;
  }

  /// Remembers a flight; true where gravity has just become known.
  bool learn_flight(const CameraFlight& flight) {
    flights.push_back(flight);
    if (flights.size() > remembered_flights) flights.erase(flights.begin());
    if (estimate_drag) learn_drag();
    const bool knew = knowledge.gravity.has_value();
    const auto gravity = estimate_gravity(flights);
    if (!gravity || gravity->flights < static_cast<int>(agreeing_flights)) return false;
    use_gravity(*gravity);
    return !knew && knowledge.gravity;
  }

  void use_gravity(GravityEstimate gravity) {
    if (gravity.sigma_rad > max_sigma_gravity_rad) return;
    gravity.sigma_rad = std::max(2 * gravity.sigma_rad, min_sigma_gravity_rad);
    knowledge.gravity = gravity;
  }

  void learn_drag() {
    double weight = 1.0 / square(sigma_unknown_drag_per_m), sum = weight * start_drag_per_m;
    for (const CameraFlight& f : flights) {
      // Each fit held the prior of its day: what it added itself is the rest.
      const double var = f.covariance(9, 9);
      if (var <= 0) continue;
      weight += 1.0 / var;
      sum += f.drag_per_m / var;
    }
    knowledge.drag_per_m = sum / weight;
    knowledge.sigma_drag_per_m = std::max(min_sigma_drag_per_m, 2.0 / std::sqrt(weight));
  }

  double window_s() const {
    const double whole = history.frame_interval_s() > slow_interval_s ? 0.6 : 0.4;
    return knowledge.gravity ? std::max(settings.min_flight_s, 0.6 * whole) : whole;
  }

  bool belongs_to_open(const CandidateRef& ref) const {
    return std::any_of(open.begin(), open.end(), [&](const GrownFlight& flight) {
      return std::binary_search(flight.points.begin(), flight.points.end(), ref);
    });
  }

  bool is_spoken_for(std::span<const CandidateRef> window) const {
    std::size_t count = 0;
    for (const CandidateRef& ref : window)
      if (history.at(ref).taken || belongs_to_open(ref)) ++count;
    return 2 * count > window.size();
  }

  /// Tests a tracklet's windows that were not tested yet, oldest first.
  void search(Tracklet& tracklet) {
    const auto& points = tracklet.points;
    const double length_s = window_s();
    for (std::size_t i = 0; i < points.size(); ++i) {
      if (!history.holds(points[i])) continue;
      const double from_s = history.at(points[i]).ray.time_s;
      if (from_s < tracklet.tested_until_s) continue;
      std::size_t j = i;
      while (j + 1 < points.size() && history.at(points[j]).ray.time_s < from_s + length_s) ++j;
      if (history.at(points[j]).ray.time_s < from_s + length_s) return;
      tracklet.tested_until_s = from_s + 0.25 * length_s;
      const std::span<const CandidateRef> window(points.data() + i, j - i + 1);
      if (static_cast<int>(window.size()) < settings.min_sightings || is_spoken_for(window))
        continue;
      if (auto flight = seed_flight(history, window, knowledge)) {
        grow_flight(history, knowledge, *flight);
        open.push_back(*std::move(flight));
      }
    }
  }

  bool is_over(const GrownFlight& flight) const {
    const std::int64_t last = history.end_frame() - 1, seen = flight.points.back().frame;
    const double unseen_s = history.frame(last).time_s - history.frame(seen).time_s;
    return unseen_s > max_pause_s || (last - seen >= over_frames && unseen_s > over_s);
  }

  bool passes(const GrownFlight& flight) const {
    const auto frames =
        static_cast<double>(flight.points.back().frame - flight.points.front().frame + 1);
    const auto seen = static_cast<double>(flight.points.size());
    // A walker's parts come and go behind each other: what is only partly seen proves nothing.
    const auto whole = std::ranges::count_if(flight.points, [&](const CandidateRef& ref) {
      return !history.at(ref).sighting.is_partial;
    });
    return whole >= settings.min_sightings &&
           flight.fit.last_s - flight.fit.first_s >= settings.min_flight_s &&
           seen >= min_seen_fraction * frames && is_plausible(history, flight);
  }

  /// Without the points that an earlier flight took. False where too little is left.
  bool release_taken(GrownFlight& flight) const {
    const auto gone = std::erase_if(flight.points, [&](const CandidateRef& ref) {
      return !history.holds(ref) || history.at(ref).taken;
    });
    if (gone == 0) return true;
    auto rest = seed_flight(history, flight.points, knowledge);
    if (rest) flight = *std::move(rest);
    return rest.has_value();
  }

  /// The last word on a flight that is over: its tests, its sightings taken.
  std::optional<Track> conclude(const GrownFlight& flight) {
    if (!passes(flight)) return std::nullopt;
    Track out{flight.fit.camera,
              {},
              is_clear_beyond(history, flight, true),
              is_clear_beyond(history, flight, false)};
    for (const CandidateRef& ref : flight.points) {
      history.take(ref);
      out.sightings.push_back(history.at(ref).sighting);
    }
    if (learn_flight(flight.fit)) look_again();
    return out;
  }

  /// With gravity known, flights that were too short or too far to tell may now be told.
  void look_again() {
    for (Tracklet& tracklet : archive) tracklet.tested_until_s = -1e300;
    for (Tracklet& tracklet : linker.live()) tracklet.tested_until_s = -1e300;
  }

  void merge_open() {
    for (std::size_t i = 0; i < open.size(); ++i)
      for (std::size_t j = i + 1; j < open.size();)
        if (merge_flights(history, knowledge, open[i], open[j]))
          open.erase(open.begin() + static_cast<std::ptrdiff_t>(j));
        else
          ++j;
  }

  std::vector<Track> tick(bool last) {
    std::vector<Tracklet> ended = linker.drain_ended();
    archive.insert(archive.end(), std::make_move_iterator(ended.begin()),
                   std::make_move_iterator(ended.end()));
    std::erase_if(archive,
                  [&](const Tracklet& t) { return !history.holds(t.points[t.points.size() / 2]); });
    std::vector<Track> out;
    if (!learn_noise()) return out;
    for (Tracklet& tracklet : archive) {
      search(tracklet);
      tracklet.tested_until_s = 1e300;  // it will not grow
    }
    for (Tracklet& tracklet : linker.live()) search(tracklet);
    // No throw outlasts the history.
    std::erase_if(open, [&](const GrownFlight& f) { return !history.holds(f.points.front()); });
    for (GrownFlight& flight : open) grow_flight(history, knowledge, flight);
    merge_open();
    std::vector<GrownFlight> still_open;
    for (GrownFlight& flight : std::exchange(open, {})) {
      if (last || is_over(flight)) {
        if (!release_taken(flight)) continue;
        settle_flight(history, knowledge, flight);
      }
      if (!last && !is_over(flight))  // settling may have carried it on to the present
        still_open.push_back(std::move(flight));
      else if (auto track = conclude(flight))
        out.push_back(*std::move(track));
    }
    open = std::move(still_open);
    return out;
  }
};

FlightFinder::FlightFinder(const RigDescription& rig, CameraId camera,
                           FlightFinderSettings settings)
    : state_(std::make_unique<State>(rig, camera, settings)) {}
FlightFinder::~FlightFinder() = default;
FlightFinder::FlightFinder(FlightFinder&&) noexcept = default;

std::vector<Track> FlightFinder::add(const FrameSightings& frame) {
  std::vector<Track> out;
  if (state_->pauses_before(frame)) out = state_->tick(true);
  if (!state_->history.add(frame)) return out;
  state_->linker.add(state_->history);
  const double now_s = state_->history.frame(state_->history.end_frame() - 1).time_s;
  if (now_s < state_->next_tick_s) return out;
  state_->next_tick_s = now_s + tick_s;
  for (Track& track : state_->tick(false)) out.push_back(std::move(track));
  return out;
}

std::optional<HostTime> FlightFinder::following_since() const {
  std::optional<HostTime> since;
  for (const GrownFlight& flight : state_->open) {
    const HostTime start = state_->history.at(flight.points.front()).sighting.time;
    since = std::min(start, since.value_or(start));
  }
  return since;
}

std::vector<Track> FlightFinder::finish() {
  std::vector<Track> out;
  for (int round = 0; round < 2; ++round) {
    for (Track& track : state_->tick(true)) out.push_back(std::move(track));
    if (const auto gravity = estimate_gravity(state_->flights)) {
      state_->use_gravity(*gravity);
      state_->look_again();
    }
  }
  return out;
}

}  // namespace throwcal
