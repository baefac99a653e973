// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/status.h"

#include <algorithm>
#include <cmath>

#include "firmware/calibration_table.h"
#include "firmware/export.h"

namespace throwcal {
namespace {

Json known(const std::optional<double>& value) {
  return value && std::isfinite(*value) ? Json(*value) : Json(nullptr);
}

/// Null of a camera that has no such settings: a film.
Json to_json(const PictureSettings& s) {
  if (!s.exposure_s && !s.gain && !s.focus && !s.white_balance_k && s.automatic.empty())
    return nullptr;
  return {{"exposure_s", known(s.exposure_s)}, {"gain", known(s.gain)},
          {"focus", known(s.focus)},           {"white_balance_k", known(s.white_balance_k)},
          {"automatic", s.automatic},          {"set_back", s.set_back}};
}

Json to_json(const CameraStats& c, int flights) {
  return {{"name", c.name},
          {"running", c.running},
          {"frames_per_s", std::round(10.0 * c.frames_per_s) / 10.0},
          {"frames", c.frames},
          {"frames_lost_by_driver", c.frames_lost_by_driver},
          {"frames_damaged", c.frames_damaged},
          {"frames_dropped", c.frames_dropped},
          {"interruptions", c.interruptions},
          {"timestamps", description(c.timestamp_source)},
          {"time_sigma_s", c.time_sigma_s},
          {"sightings", c.sightings},
          {"flights", flights},
          {"view", description(c.view)},
          {"mode", c.identity.mode.empty() ? Json(nullptr) : Json(c.identity.mode)},
          {"settings", to_json(c.settings)},
          {"error", c.error.empty() ? Json(nullptr) : Json(c.error)}};
}

/// Of all cameras; unknown as long as one camera's is.
void add_worst_sigma(const Calibration& calibration, Status& status) {
  double position_m = 0.0, rotation_rad = 0.0;
  for (const CameraCalibration& camera : calibration.cameras) {
    const auto sigma = sigma_of(camera);
    if (!sigma) return;
    position_m = std::max(position_m, sigma->position_m);
    rotation_rad = std::max(rotation_rad, sigma->rotation_rad);
  }
  status.worst_sigma_position_m = position_m;
  status.worst_sigma_rotation_rad = rotation_rad;
}

std::string advice_for_throwing(const Status& s) {
  if (s.throws == 0) return "throw the ball where two cameras or more see it fly";
  if (s.verdict && *s.verdict == Verdict::accepted)
    return s.ends_itself && s.throws < s.target_throws
               ? "good enough; throw again, so that " + std::to_string(s.target_throws) + " agree"
               : "good enough; stop, or throw on";
  if (s.next_throw) return *s.next_throw;
  return s.reasons.empty() ? "throw again" : s.reasons.front();
}

std::string advice_when_done(const Status& s) {
  if (s.throws == 0) return "no throw was seen: start again, and throw where two cameras see it";
  if (!s.verdict || *s.verdict == Verdict::accepted) return "fetch the calibration";
  return s.reasons.empty() ? "start again, and throw more often" : s.reasons.front();
}

}  // namespace

std::string advice(const Status& s) {
  switch (s.state) {
    case SessionState::idle:
      return s.calibration_problem ? "calibrate again: " + *s.calibration_problem
                                   : "press capture, then throw the ball";
    case SessionState::warming_up:
      return "wait: the cameras learn their background";
    case SessionState::capturing:
    case SessionState::throw_seen:
      return advice_for_throwing(s);
    case SessionState::solving:
      return "wait: the result is being made";
    case SessionState::done:
      return advice_when_done(s);
    case SessionState::fault:
      return s.fault ? "mend this: " + *s.fault : "wait: the fault is being looked into";
  }
  return "";
}

Status status_of(const Session& session, const Rig& rig) {
  Status out;
  out.state = session.state();
  out.session = session.id();
  out.throws = session.throws();
  out.cameras = rig.stats();
  out.flights = session.flights();
  out.target_throws = session.goal().min_throws;
  out.ends_itself = session.goal().ends_itself;
  out.sightings_dropped = rig.sightings_dropped();
  if (const auto& calibration = session.calibration()) {
    out.verdict = calibration->verdict;
    out.reasons = calibration->reasons;
    if (calibration->next_throw) out.next_throw = calibration->next_throw->text;
    add_worst_sigma(*calibration, out);
  }
  return out;
}

Json to_json(const Status& s) {
  Json cameras = Json::array();
  for (std::size_t i = 0; i < s.cameras.size(); ++i)
    cameras.push_back(to_json(s.cameras[i], s.flights.at(i)));
  return {
      {"state", to_string(s.state)},
      {"session", s.session ? Json(*s.session) : Json(nullptr)},
      {"throws", s.throws},
      {"worst_sigma_position_m", known(s.worst_sigma_position_m)},
      {"worst_sigma_rotation_rad", known(s.worst_sigma_rotation_rad)},
      {"verdict", s.verdict ? Json(to_string(*s.verdict)) : Json(nullptr)},
      {"calibration", s.calibration ? Json(*s.calibration) : Json(nullptr)},
      {"reasons", s.reasons},
      {"target",
       {{"position_m", s.target.position_m},
        {"rotation_rad", s.target.rotation_rad},
        {"throws", s.target_throws}}},
      {"ends_itself", s.ends_itself},
      {"next_throw", s.next_throw ? Json(*s.next_throw) : Json(nullptr)},
      {"advice", advice(s)},
      {"cameras", std::move(cameras)},
      {"sightings_dropped", s.sightings_dropped},
      {"calibration_problem", s.calibration_problem ? Json(*s.calibration_problem) : Json(nullptr)},
      {"fault", s.fault ? Json(*s.fault) : Json(nullptr)},
      {"can", s.can},
      {"uptime_s", std::round(10.0 * s.uptime_s) / 10.0},
      {"software", software_name()}};
}

}  // namespace throwcal
