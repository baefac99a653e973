// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/session.h"

#include <algorithm>

namespace throwcal {

std::string to_string(SessionState state) {
  switch (state) {
    case SessionState::idle:
      return "idle";
    case SessionState::warming_up:
      return "warming-up";
    case SessionState::capturing:
      return "capturing";
    case SessionState::solving:
      return "solving";
    case SessionState::done:
      return "done";
  }
  return "idle";
}

void Session::begin(std::int64_t id, SessionState state) {
  state_ = state;
  id_ = id;
  throws_ = 0;
  std::ranges::fill(flights_, 0);
  calibration_.reset();
}

std::optional<std::string> Session::start(std::int64_t id, bool cameras_warm) {
  if (is_watching()) return "session " + std::to_string(*id_) + " is capturing already";
  if (state_ == SessionState::solving)
    return "session " + std::to_string(*id_) + " is still being solved";
  begin(id, cameras_warm ? SessionState::capturing : SessionState::warming_up);
  return {};
}

void Session::cameras_became_warm() {
  if (state_ == SessionState::warming_up) state_ = SessionState::capturing;
}

std::optional<std::string> Session::stop() {
  if (!is_watching()) return "nothing is being captured (state " + to_string(state_) + ")";
  state_ = SessionState::solving;
  return {};
}

void Session::resume_solving(std::int64_t id, const std::vector<CameraId>& flights) {
  begin(id, SessionState::solving);
  for (const CameraId camera : flights) ++flights_.at(camera);
}

void Session::flight_found(CameraId camera) { ++flights_.at(camera); }

void Session::calibrated(int throws, std::shared_ptr<const Calibration> calibration) {
  throws_ = throws;
  calibration_ = std::move(calibration);
}

void Session::solved() {
  if (state_ == SessionState::solving) state_ = SessionState::done;
}

}  // namespace throwcal
