// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "estimator/calibration.h"

namespace throwcal {

enum class SessionState {
  idle,        ///< ready: nothing is being captured
  warming_up,  ///< capturing, but not every camera has learnt its background yet
  capturing,   ///< throws count
  throw_seen,  ///< the same, and a flight was found that is in no calibration yet
  solving,     ///< no more throws; the last calibration is being made
  done,        ///< the result is stored
  fault,       ///< nothing can be captured; the status says why
};
constexpr std::size_t session_states = 7;
/// "idle", "warming-up", "capturing", "throw-seen", "solving", "done", "fault"
std::string to_string(SessionState state);

/// Whatever button, link, cameras, estimator and store can do to a session.
enum class SessionEvent {
  start,          ///< somebody wants to capture
  stop,           ///< enough: solve
  abort,          ///< throw this session away
  cameras_warm,   ///< every camera has learnt its background
  flight,         ///< a flight was found and stored
  calibrated,     ///< of all flights so far, and stored
  good_enough,    ///< that calibration reaches the target
  cameras_ended,  ///< no more frames will come
  solved,         ///< the last calibration is stored
  resume,         ///< the box was switched off in a session
  trouble,        ///< nothing could be captured now: the store, or the cameras
  mended,         ///< it could again
};
constexpr std::size_t session_events = 12;
std::string to_string(SessionEvent event);  ///< "start", "stop", ...

/// What an event does in a state: where it leads, or why it is refused. Every pair has one.
struct SessionOutcome {
  SessionState next;
  std::string_view refusal;  ///< empty: it is not refused
};
SessionOutcome outcome(SessionState state, SessionEvent event);

/// The same for people, in Markdown: a row an event, a column a state. (firmware/session.md)
std::string session_table();

/// When a session ends by itself.
struct SessionGoal {
  bool ends_itself = true;  ///< once the verdict is `accepted` ...
  int min_throws = 3;       ///< ... and so many throws agree
};

/// What the box is doing for whoever throws: a state machine without input or output. What can be
/// refused returns why, or nothing.
class Session {
 public:
  explicit Session(std::size_t cameras) : flights_(cameras) {}

  /// Why this event would be refused now; nothing where it would not.
  [[nodiscard]] std::optional<std::string> refusal(SessionEvent event) const;

  [[nodiscard]] std::optional<std::string> start(std::int64_t id, const SessionGoal& goal = {});
  [[nodiscard]] std::optional<std::string> stop() { return happen(SessionEvent::stop); }
  [[nodiscard]] std::optional<std::string> abort();
  void cameras_became_warm() { note(SessionEvent::cameras_warm); }
  void cameras_ended() { note(SessionEvent::cameras_ended); }
  /// A session of before a restart, whose throws are there but not its result.
  [[nodiscard]] std::optional<std::string> resume_solving(std::int64_t id,
                                                          const std::vector<CameraId>& flights);
  void flight_found(CameraId camera);
  /// `throws`: how often somebody threw.
  void calibrated(int throws, std::shared_ptr<const Calibration> calibration);
  void solved() { note(SessionEvent::solved); }
  void trouble() { note(SessionEvent::trouble); }
  void mended() { note(SessionEvent::mended); }

  SessionState state() const { return state_; }
  std::optional<std::int64_t> id() const { return id_; }
  /// Whether frames are looked at for flights.
  bool is_watching() const;
  int throws() const { return throws_; }
  const SessionGoal& goal() const { return goal_; }
  const std::vector<int>& flights() const { return flights_; }  ///< a count each camera
  const std::shared_ptr<const Calibration>& calibration() const { return calibration_; }

 private:
  std::optional<std::string> happen(SessionEvent event);
  void note(SessionEvent event) { (void)happen(event); }  ///< of those that are never refused
  void begin(std::int64_t id);

  SessionState state_ = SessionState::idle;
  SessionGoal goal_;
  std::optional<std::int64_t> id_;
  int throws_ = 0;
  std::vector<int> flights_;
  std::shared_ptr<const Calibration> calibration_;
};

}  // namespace throwcal
