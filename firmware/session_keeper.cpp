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
  if (!stored([&] { id = store_.start_session(std::move(facts)); })) return fault_;
  waiting_.clear();
  evidence_.clear();
  flights_stored_ = 0;
  stopped_utc_.reset();
  calibration_id_.reset();
  began_here_ = id;
  has_background_.assign(session_.flights().size(), !keep_evidence_);
  gather_backgrounds();
  return session_.start(id, goal);
}

void SessionKeeper::stop(const std::string& utc) {
  stopped_utc_ = utc;
  catch_up();
}

std::optional<std::string> SessionKeeper::abort() {
  if (auto why = session_.abort()) return why;
  waiting_.clear();
  evidence_.clear();
  stopped_utc_.reset();
  calibration_id_.reset();
  has_background_.clear();
  stored([&] { store_.finish_session("aborted"); });
  return {};
}

std::optional<std::vector<Track>> SessionKeeper::resume(const std::vector<std::string>& cameras,
                                                        const std::string& utc) {
  std::optional<Store::Unsolved> unsolved;
  if (!stored([&] { unsolved = store_.resume(cameras); }) || !unsolved) return {};
  std::vector<CameraId> seen_by;
  for (const Track& flight : unsolved->flights) seen_by.push_back(flight.camera);
  if (session_.resume_solving(unsolved->session, seen_by)) return {};
  flights_stored_ = std::ssize(unsolved->flights);
  if (store_.facts().stopped_utc.empty()) stop(utc);
  return std::move(unsolved->flights);
}

void SessionKeeper::take(News news) {
  if (news.session == 0 || news.session != session_.id()) return;  // it was thrown away
  if (news.flights_dropped > 0)
    once_.warning("flights", std::to_string(news.flights_dropped) +
                                 " flights were lost: the main loop was too slow");
  if (news.calibration)  // only the newest matters
    for (News& older : waiting_) older.calibration.reset();
  waiting_.push_back(std::move(news));
  catch_up();
}

void SessionKeeper::catch_up() {
  stored([&] {
    store_.ready();
    while (!waiting_.empty()) {
      store_and_tell(waiting_.front());
      waiting_.pop_front();
    }
    if (stopped_utc_ && store_.open_session()) store_.stop_session(*stopped_utc_);
    stopped_utc_.reset();
  });
}

/// Each part is done with before the next is tried, so that none is stored twice.
void SessionKeeper::store_and_tell(News& news) {
  if (!news.flights.empty()) {
    store_.add_flights(news.flights);
    gather_evidence(news.flights);
    flights_stored_ += std::ssize(news.flights);
    for (const Track& flight : std::exchange(news.flights, {}))
      session_.flight_found(flight.camera);
  }
  if (news.calibration) {
    store_calibration(news);
    session_.calibrated(news.throws, std::exchange(news.calibration, {}));
  }
  if (news.solved) {
    if (stopped_utc_) store_.stop_session(*std::exchange(stopped_utc_, {}));
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
  calibration_id_ = store_.add_calibration(
      {0, document.at("created_utc").get<std::string>(), document.at("verdict").get<std::string>(),
       news.throws, static_cast<std::int64_t>(news.calibrated_flights),
       document.dump(-1, ' ', false, Json::error_handler_t::replace)});
}

/// What was behind the cameras when the session began, and of those that came later since then.
SessionFacts::Json SessionKeeper::devices_now() const {
  SessionFacts::Json devices = store_.facts().devices;
  if (began_here_ != session_.id()) return devices;
  const SessionFacts::Json now = devices_of(rig_.stats(), true);
  for (const auto& [name, device] : now.items())
    if (!devices.contains(name)) devices[name] = device;
  return devices;
}

/// A picture of each camera as the session begins, or as soon as there is one: where it looked, in
/// which light.
void SessionKeeper::gather_backgrounds() {
  constexpr int max_width = 640;
  for (CameraId camera = 0; camera < has_background_.size(); ++camera) {
    if (has_background_[camera]) continue;
    if (const auto lease = rig_.newest(camera)) {
      has_background_[camera] = true;
      const Frame& frame = lease->frame();
      evidence_.push_back(
          evidence_of(crop(frame, whole_picture(frame.image, max_width)), camera, 0));
    }
  }
}

/// The pictures are in memory for some seconds only: they are copied at once, and stored later.
void SessionKeeper::gather_evidence(const std::vector<Track>& flights) {
  if (!keep_evidence_ || began_here_ != session_.id()) return;
  for (std::size_t i = 0; i < flights.size(); ++i)
    for (const BallSighting& sighting : flights[i].sightings)
      if (evidence_.size() < max_evidence_waiting)
        if (const auto crop = rig_.crop_of(sighting))
          evidence_.push_back(evidence_of(*crop, sighting.camera,
                                          flights_stored_ + static_cast<std::int64_t>(i) + 1));
}

void SessionKeeper::store_evidence() {
  gather_backgrounds();
  if (evidence_.empty() || !store_.open_session()) return;
  try {
    store_.add_evidence(std::exchange(evidence_, {}));
    once_.forget("evidence");
  } catch (const StoreError& error) {
    once_.warning("evidence", std::string("pictures of sightings are not kept: ") + error.what());
  }
}

}  // namespace throwcal
