// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/session.h"

#include <algorithm>

namespace throwcal {
namespace {

constexpr std::array<std::string_view, session_states> state_names{
    "idle", "warming-up", "capturing", "throw-seen", "solving", "done", "fault"};
constexpr std::array<std::string_view, session_events> event_names{
    "start",       "stop",          "abort",  "cameras-warm", "flight",  "calibrated",
    "good-enough", "cameras-ended", "solved", "resume",       "trouble", "mended"};

/// A cell of the table: to another state, nowhere, or a refusal.
struct Cell {
  std::optional<SessionState> to;
  std::string_view refusal;
};
constexpr Cell idle{SessionState::idle, {}}, warm{SessionState::warming_up, {}},
    capt{SessionState::capturing, {}}, seen{SessionState::throw_seen, {}},
    solv{SessionState::solving, {}}, done{SessionState::done, {}}, flt{SessionState::fault, {}};
constexpr Cell same{};
constexpr Cell busy{{}, "a session is capturing already"};
constexpr Cell wait{{}, "a session is still being solved"};
constexpr Cell hurt{{}, "nothing can be captured until the fault is mended"};
constexpr Cell none{{}, "nothing is being captured"};
constexpr Cell kept{{}, "the session is over and its result is kept"};

// Each row an event, each column a state, in the order of their enums.
constexpr std::array<std::array<Cell, session_states>, session_events> table{{
    // idle, warming-up, capturing, throw-seen, solving, done, fault
    {warm, busy, busy, busy, wait, warm, hurt},  // start
    {none, solv, solv, solv, same, same, none},  // stop: twice is once
    {none, idle, idle, idle, idle, kept, none},  // abort
    {same, capt, same, same, same, same, same},  // cameras-warm
    {same, same, seen, same, same, same, same},  // flight: counts while cameras warm up, too
    {same, same, same, capt, same, same, same},  // calibrated
    {same, solv, solv, solv, same, same, same},  // good-enough
    {same, solv, solv, solv, same, same, same},  // cameras-ended
    {same, same, same, same, done, same, same},  // solved
    {solv, busy, busy, busy, wait, solv, hurt},  // resume
    {flt, same, same, same, same, flt, same},    // trouble: a session goes on and catches up
    {same, same, same, same, same, same, idle},  // mended
}};

const Cell& cell(SessionState state, SessionEvent event) {
  return table.at(static_cast<std::size_t>(event)).at(static_cast<std::size_t>(state));
}

std::string text_of(const Cell& cell) {
  if (!cell.refusal.empty()) return "refused: " + std::string(cell.refusal);
  return cell.to ? "→ " + to_string(*cell.to) : "stays";
}

}  // namespace

std::string to_string(SessionState state) {
  return std::string(state_names.at(static_cast<std::size_t>(state)));
}

std::string to_string(SessionEvent event) {
  return std::string(event_names.at(static_cast<std::size_t>(event)));
}

SessionOutcome outcome(SessionState state, SessionEvent event) {
  const Cell& found = cell(state, event);
  return {found.to.value_or(state), found.refusal};
}

std::string session_table() {
  std::string out = "| event |", rule = "|---|";
  for (const std::string_view name : state_names) {
    out += " in " + std::string(name) + " |";
    rule += "---|";
  }
  out += "\n" + rule + "\n";
  for (std::size_t e = 0; e < session_events; ++e) {
    out += "| " + std::string(event_names[e]) + " |";
    for (std::size_t s = 0; s < session_states; ++s) out += " " + text_of(table[e][s]) + " |";
    out += "\n";
  }
  return out;
}

std::optional<std::string> Session::refusal(SessionEvent event) const {
  const std::string_view why = outcome(state_, event).refusal;
  if (why.empty()) return {};
  return std::string(why) + " (state " + to_string(state_) +
         (id_ ? ", session " + std::to_string(*id_) : "") + ")";
}

std::optional<std::string> Session::happen(SessionEvent event) {
  if (auto why = refusal(event)) return why;
  state_ = outcome(state_, event).next;
  return {};
}

void Session::begin(std::int64_t id) {
  id_ = id;
  goal_ = {};
  throws_ = 0;
  std::ranges::fill(flights_, 0);
  calibration_.reset();
}

std::optional<std::string> Session::start(std::int64_t id, const SessionGoal& goal) {
  if (auto why = happen(SessionEvent::start)) return why;
  begin(id);
  goal_ = goal;
  return {};
}

std::optional<std::string> Session::abort() {
  if (auto why = happen(SessionEvent::abort)) return why;
  begin(0);
  id_.reset();
  return {};
}

std::optional<std::string> Session::resume_solving(std::int64_t id,
                                                   const std::vector<CameraId>& flights) {
  if (auto why = happen(SessionEvent::resume)) return why;
  begin(id);
  for (const CameraId camera : flights) ++flights_.at(camera);
  return {};
}

void Session::flight_found(CameraId camera) {
  if (!id_) return;  // of a session that was thrown away meanwhile
  ++flights_.at(camera);
  note(SessionEvent::flight);
}

void Session::calibrated(int throws, std::shared_ptr<const Calibration> calibration) {
  if (!id_) return;
  throws_ = throws;
  calibration_ = std::move(calibration);
  note(SessionEvent::calibrated);
  if (goal_.ends_itself && throws_ >= goal_.min_throws && calibration_ &&
      calibration_->verdict == Verdict::accepted)
    note(SessionEvent::good_enough);
}

bool Session::is_watching() const {
  return state_ == SessionState::warming_up || state_ == SessionState::capturing ||
         state_ == SessionState::throw_seen;
}

}  // namespace throwcal
