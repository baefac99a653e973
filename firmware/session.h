// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "estimator/calibration.h"

namespace throwcal {

enum class SessionState {
  idle,        ///< no session since the start
  warming_up,  ///< started, but not every camera has learnt its background yet
  capturing,   ///< throws count
  solving,     ///< no more throws; the last calibration is being made
  done,        ///< the result is stored
};
std::string to_string(
    SessionState state);  ///< "idle", "warming-up", "capturing", "solving", "done"

/// What the box is doing for whoever throws: a state machine without input or output. Each event
/// returns why it is refused, or nothing.
class Session {
 public:
  explicit Session(std::size_t cameras) : flights_(cameras) {}

  /// A new session. `cameras_warm`: every camera has learnt its background.
  [[nodiscard]] std::optional<std::string> start(std::int64_t id, bool cameras_warm);
  void cameras_became_warm();
  [[nodiscard]] std::optional<std::string> stop();
  /// A session of before a restart, whose throws are there but not its result.
  void resume_solving(std::int64_t id, const std::vector<CameraId>& flights);
  void flight_found(CameraId camera);
  void calibrated(int throws, std::shared_ptr<const Calibration> calibration);
  void solved();  ///< the result is stored

  SessionState state() const { return state_; }
  std::optional<std::int64_t> id() const { return id_; }
  /// Whether frames are looked at for flights.
  bool is_watching() const {
    return state_ == SessionState::warming_up || state_ == SessionState::capturing;
  }
  int throws() const { return throws_; }
  const std::vector<int>& flights() const { return flights_; }  ///< a count each camera
  const std::shared_ptr<const Calibration>& calibration() const { return calibration_; }

 private:
  void begin(std::int64_t id, SessionState state);

  SessionState state_ = SessionState::idle;
  std::optional<std::int64_t> id_;
  int throws_ = 0;
  std::vector<int> flights_;
  std::shared_ptr<const Calibration> calibration_;
};

}  // namespace throwcal
