// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/session_keeper.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "firmware/camera_changes.h"
#include "firmware/export.h"

namespace throwcal {
namespace {

constexpr std::size_t max_evidence_waiting = 10'000;  // of some 2 kB each

Evidence evidence_of(const PictureCrop& crop, CameraId camera, std::int64_t flight) {
  return {camera,           crop.time,         flight,
          crop.area.x_px,   crop.area.y_px,    crop.area.width,
          crop.area.height, crop.area.step_px, std::string(crop.pixels.begin(), crop.pixels.end())};
}

}  // namespace

SessionKeeper::SessionKeeper(Session& session, Store& store, Rig& rig, bool keep_evidence)
    : session_(session), store_(store), rig_(rig), keep_evidence_(keep_evidence) {
  stored([&] { store_.ready(); });
}

/// Runs what writes to the store; a failure is the box's fault, shown until a write succeeds.
template <typename Work>
bool SessionKeeper::stored(const Work& work) {
  try {
    work();
    fault_.reset();
    once_.forget("store");
    return true;
  } catch (const StoreError& error) {
    fault_ = error.what();
    once_.warning("store", error.what());
    return false;
  }
}

std::optional<std::string> SessionKeeper::begin(SessionFacts facts, const SessionGoal& goal) {
  if (auto why = session_.refusal(SessionEvent::start)) return why;
  std::int64_t id = 0;
  const bool has_begun = stored([&] {
    finish_aborted();
    id = store_.start_session(std::move(facts));
  });
  if (!has_begun) return fault_;
  now_ = {.has_background = std::vector<bool>(session_.flights().size(), !keep_evidence_),
          .began_here = true};
  gather_backgrounds();
  return session_.start(id, goal);
}

void SessionKeeper::stop(const std::string& utc) {
  now_.stopped_utc = utc;
  catch_up();
}

std::optional<std::string> SessionKeeper::abort() {
  if (auto why = session_.abort()) return why;
  now_ = {.is_aborted = true};
  catch_up();
  return {};
}

/// Else the next start would take it for one that was interrupted, and solve it.
void SessionKeeper::finish_aborted() {
  if (now_.is_aborted && store_.open_session()) store_.finish_session("aborted");
  now_.is_aborted = false;
}

std::optional<Store::Unsolved> SessionKeeper::resume(const std::vector<std::string>& cameras,
                                                     const std::string& utc) {
  if (session_.refusal(SessionEvent::resume) || !stored([&] { store_.ready(); })) return {};
  std::optional<Store::Unsolved> unsolved;
  try {
    unsolved = store_.resume(cameras);
  } catch (const StoreError& error) {
    log_warning(std::string("the last session can't be solved: ") + error.what());
  }
  if (!unsolved) return {};
  std::vector<CameraId> seen_by;
  for (const Track& flight : unsolved->flights) seen_by.push_back(flight.camera);
  (void)session_.resume_solving(unsolved->session, seen_by);  // it was asked above
  now_ = {.flights_stored = std::ssize(unsolved->flights)};
  if (unsolved->facts.stopped_utc.empty()) stop(utc);
  return unsolved;
}

void SessionKeeper::forget(std::int64_t session) {
  if (session == session_.id()) now_.calibration_id.reset();
}

void SessionKeeper::take(News news) {
  if (news.session == 0 || news.session != session_.id()) return;  // it was thrown away
  if (news.flights_dropped > 0)
    once_.warning("flights", std::to_string(news.flights_dropped) +
                                 " flights were lost: the main loop was too slow");
  if (news.calibration)  // only the newest matters
    for (News& older : now_.waiting) older.calibration.reset();
  now_.waiting.push_back(std::move(news));
  catch_up();
}

void SessionKeeper::catch_up() {
  stored([&] {
    finish_aborted();
    store_.ready();
    while (!now_.waiting.empty()) {
      store_and_tell(now_.waiting.front());
      now_.waiting.pop_front();
    }
    if (now_.stopped_utc && store_.open_session()) store_.stop_session(*now_.stopped_utc);
    now_.stopped_utc.reset();
  });
}

/// Each part is done with before the next is tried, so that none is stored twice.
void SessionKeeper::store_and_tell(News& news) {
  if (!news.flights.empty()) {
    store_.add_flights(news.flights);
    gather_evidence(news.flights);
    now_.flights_stored += std::ssize(news.flights);
    for (const Track& flight : std::exchange(news.flights, {}))
      session_.flight_found(flight.camera);
  }
  if (news.calibration) {
    store_calibration(news);
    session_.calibrated(news.throws, std::exchange(news.calibration, {}));
  }
  if (news.solved) {
    if (now_.stopped_utc) store_.stop_session(*std::exchange(now_.stopped_utc, {}));
    store_evidence();
    store_.finish_session("done");
    session_.solved();
  }
}

/// One of no throws says only that there were none: it takes no other's place.
void SessionKeeper::store_calibration(const News& news) {
  if (news.calibration->throws.empty()) return;
  const SessionFacts::Json devices = devices_now();
  if (devices != store_.facts().devices) store_.set_devices(devices);
  Json document = to_json(*news.calibration, utc_now());
  add_devices(document, devices);
  now_.calibration_id = store_.add_calibration(
      {0, document.at("created_utc").get<std::string>(), document.at("verdict").get<std::string>(),
       news.throws, static_cast<std::int64_t>(news.calibrated_flights),
       document.dump(-1, ' ', false, Json::error_handler_t::replace)});
}

/// What was behind the cameras when the session began, and of those that came later since then.
SessionFacts::Json SessionKeeper::devices_now() const {
  SessionFacts::Json devices = store_.facts().devices;
  if (!now_.began_here) return devices;
  const SessionFacts::Json now = devices_of(rig_.stats(), true);
  for (const auto& [name, device] : now.items())
    if (!devices.contains(name)) devices[name] = device;
  return devices;
}

/// A picture of each camera as the session begins, or as soon as there is one: where it looked, in
/// which light.
void SessionKeeper::gather_backgrounds() {
  constexpr int max_width = 640;
  for (CameraId camera = 0; camera < now_.has_background.size(); ++camera) {
    if (now_.has_background[camera]) continue;
    if (const auto lease = rig_.newest(camera)) {
      now_.has_background[camera] = true;
      const Frame& frame = lease->frame();
      now_.evidence.push_back(
          evidence_of(crop(frame, whole_picture(frame.image, max_width)), camera, 0));
    }
  }
}

/// The pictures are in memory for some seconds only: they are copied at once, and stored later.
void SessionKeeper::gather_evidence(const std::vector<Track>& flights) {
  if (!keep_evidence_ || !now_.began_here) return;
  for (std::size_t i = 0; i < flights.size(); ++i)
    for (const BallSighting& sighting : flights[i].sightings)
      if (now_.evidence.size() < max_evidence_waiting)
        if (const auto crop = rig_.crop_of(sighting))
          now_.evidence.push_back(evidence_of(
              *crop, sighting.camera, now_.flights_stored + static_cast<std::int64_t>(i) + 1));
}

void SessionKeeper::store_evidence() {
  gather_backgrounds();
  if (now_.evidence.empty() || !store_.open_session()) return;
  try {
    store_.add_evidence(std::exchange(now_.evidence, {}));
    once_.forget("evidence");
  } catch (const StoreError& error) {
    once_.warning("evidence", std::string("pictures of sightings are not kept: ") + error.what());
  }
}

}  // namespace throwcal
