// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/daemon.h"

#include <sys/epoll.h>
#include <sys/resource.h>
#include <sys/utsname.h>
#include <systemd/sd-daemon.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdlib>

#include "firmware/camera_changes.h"
#include "firmware/camera_health.h"
#include "firmware/cameras.h"
#include "firmware/export.h"
#include "firmware/input_error.h"
#include "firmware/metrics.h"
#include "firmware/session_replay.h"
#include "firmware/support_bundle.h"
#include "firmware/text_file.h"

namespace throwcal {
namespace {

using namespace std::chrono_literals;

constexpr auto tick_period = 100ms;        // notifications come at most this often
constexpr auto heartbeat_period = 1000ms;  // counters alone are told this often
/// How long the stop waits for the estimator.
constexpr auto estimator_patience = 500ms;
/// Behind the cameras' threads: however busy clients or a calibration keep the processor, pictures
/// come first. Threads made later inherit it.
constexpr int niceness = 10;

std::string host_name() {
  utsname names{};
  uname(&names);
  return names.nodename;
}

std::vector<std::string> camera_names(const RigDescription& rig) {
  std::vector<std::string> out;
  for (const CameraDescription& camera : rig.cameras) out.push_back(camera.name);
  return out;
}

/// A box whose disk can't be written still works, by its button: nobody knows its token then.
std::string token_of(const Config& config, const DaemonSettings& settings) {
  const auto file = config.token_file.value_or(settings.state_dir / "token");
  try {
    return token_in(file);
  } catch (const InputError& error) {
    if (std::filesystem::exists(file)) throw;
    log_warning(std::string(error.what()) +
                "; until then only the button lets anybody change "
                "something");
    return new_token();
  }
}

/// A status without what changes all the time: is it worth telling at once?
Json essence(Json status) {
  status.erase("uptime_s");
  if (Json& can = status["can"]; can.is_object())
    can = {{"state", can["state"]}, {"problem", can["problem"]}};
  for (Json& camera : status["cameras"])
    for (const char* counter : {"frames", "frames_per_s", "sightings", "time_sigma_s"})
      camera.erase(counter);
  return status;
}

}  // namespace

Daemon::Daemon(const Config& config, DaemonSettings settings)
    : config_(config),
      settings_(std::move(settings)),
      store_(settings_.state_dir, {.keep_free_bytes = config_.keep_free_bytes}),
      access_(token_of(config_, settings_)),
      rig_(open_rig(config_, log_warning)),
      session_(config_.rig.cameras.size()),
      keeper_(session_, store_, rig_, config_.keep_evidence),
      rpc_([this] { return access_.is_open(Access::Clock::now()); }),
      link_(loop_, config_.listen, rpc_, [this] { return hello(); }),
      previews_(rig_) {
  add_methods(rpc_, *this);
  if (config_.can) can_.emplace(loop_, *config_.can, rpc_, access_.short_key());
  if (config_.http.listen) open_http();
  term_ = loop_.on_signal(SIGTERM, [this] { loop_.quit(); });
  interrupt_ = loop_.on_signal(SIGINT, [this] { loop_.quit(); });
  hang_up_ = loop_.on_signal(SIGHUP, [this] { reload(); });
  news_source_ = loop_.on_io(news_.fd(), EPOLLIN, [this](std::uint32_t) {
    take_news();
    tell();
  });
  ticker_ = loop_.on_timer(tick_period, [this] { tick(); });
}

Daemon::~Daemon() = default;

void Daemon::open_http() {
  std::vector<std::string> names;
  for (const CameraDescription& camera : config_.rig.cameras) names.push_back(camera.name);
  const auto preview = [this](CameraId camera) {
    return previews_.newest(camera, Previews::Clock::now());
  };
  http_.emplace(loop_, *config_.http.listen, rpc_,
                HttpSources{names, preview, [this] { return metrics(); },
                            [this] { return support_bundle(rpc_, config_, metrics()); },
                            [this](std::int64_t session) { return session_file(session); }});
}

std::optional<std::filesystem::path> Daemon::session_file(std::int64_t session) const {
  try {
    return store_.file_of(session);
  } catch (const StoreError& error) {
    throw RpcError(rpc_refused, error.what());
  }
}

std::string Daemon::metrics() {
  return to_metrics(status(), {config_.rig.target, link_.clients(), http_->connections()});
}

void Daemon::run() {
  rig_.start();
  setpriority(PRIO_PROCESS, 0, niceness);  // on Linux, of the calling thread only
  estimator_.emplace(config_.rig, rig_, news_, config_.pre_trigger);
  resume_unsolved();
  panel_.emplace(loop_, config_.button, config_.light, [this](Press press) { return obey(press); });
  if (!settings_.port_file.empty())
    write_text_file(settings_.port_file, std::to_string(link_.port()) + "\n");
  if (!settings_.http_port_file.empty() && http_)
    write_text_file(settings_.http_port_file, std::to_string(http_->port()) + "\n");
  const std::string listening =
      "listening at " + config_.listen.host + ":" + std::to_string(link_.port()) +
      (http_ ? ", HTTP " + config_.http.listen->host + ":" + std::to_string(http_->port()) : "");
  log_info(software_name() + " with " + std::to_string(config_.rig.cameras.size()) + " cameras, " +
           listening);
  sd_notifyf(0, "READY=1\nSTATUS=%s", listening.c_str());
  loop_.run();
  shut_down();
}

/// What was acknowledged is on the disk already; what the estimator has posted since goes there
/// too.
void Daemon::shut_down() {
  sd_notify(0, "STOPPING=1\nSTATUS=stopping");
  http_.reset();
  const bool ended = estimator_->stop_within(estimator_patience);
  take_news();
  rig_.stop();
  panel_.reset();  // its light goes out
  log_info("stopped in state " + to_string(session_.state()));
  if (!ended) std::_Exit(0);  // the estimator is at it still; its flights are on the disk
}

/// Once, as soon as the store can be read.
void Daemon::resume_unsolved() {
  if (has_resumed_ || keeper_.fault() || session_.refusal(SessionEvent::resume)) return;
  auto unsolved = keeper_.resume(camera_names(config_.rig), utc_now());
  has_resumed_ = !keeper_.fault();
  if (!unsolved) return;
  const std::string name = "session " + std::to_string(unsolved->session);
  set_log_session(unsolved->session);
  log_info(name + " was interrupted; solving its " + std::to_string(unsolved->flights.size()) +
           " flights");
  RigDescription rig = config_.rig;
  try {
    rig = config_of(unsolved->facts, name).rig;
  } catch (const InputError& error) {
    log_warning(std::string(error.what()) + "; it is solved with the present one");
  }
  estimator_->solve(unsolved->session, rig, std::move(unsolved->flights));
}

/// Makes a change that may end the capture, and if it does, sees to its end.
void Daemon::follow(const std::function<void()>& change) {
  const bool was_watching = session_.is_watching();
  change();
  if (was_watching && session_.state() == SessionState::solving) end_capture();
}

void Daemon::end_capture() {
  keeper_.stop(utc_now());
  estimator_->finish_session();
  log_info(Happening::session_ended,
           "session " + std::to_string(*session_.id()) + " ended; solving");
}

void Daemon::take_news() {
  News news = news_.take();
  const bool ended = news.cameras_ended, was_watching = session_.is_watching();
  follow([&] { keeper_.take(std::move(news)); });
  if (was_watching && !session_.is_watching()) ended_itself_ = std::chrono::steady_clock::now();
  if (ended) {
    log_warning("every camera has ended");
    cameras_have_ended_ = true;
    follow([&] { session_.cameras_ended(); });
  }
}

/// Whether the last calibration is that of the cameras as they are now, looked into again only when
/// one of both has changed.
void Daemon::judge_last_calibration() {
  Json devices = devices_of(rig_.stats(), false);
  if (devices == judged_devices_ && judged_calibration_ == keeper_.calibration_id()) return;
  calibration_problem_.reset();
  try {
    if (const auto latest = store_.latest_calibration())
      for (const std::string& change : camera_changes(*latest, devices))
        calibration_problem_ = (calibration_problem_ ? *calibration_problem_ + "; " : "") + change;
  } catch (const StoreError& error) {
    once_.warning("store", error.what());
    return;
  } catch (const Json::exception& error) {
    calibration_problem_ = std::string("its document is none: ") + error.what();
  }
  if (calibration_problem_)
    log_warning("the last calibration is not of these cameras: " + *calibration_problem_);
  judged_devices_ = std::move(devices);
  judged_calibration_ = keeper_.calibration_id();
}

/// Whether anything could be captured.
void Daemon::judge_trouble() {
  camera_trouble_ = camera_trouble(rig_.stats());
  keeper_.fault() || camera_trouble_ ? session_.trouble() : session_.mended();
}

JsonRpc::Json Daemon::latest_calibration() {
  judge_last_calibration();
  if (calibration_problem_)
    throw RpcError(rpc_refused, "the last calibration is not of these cameras, calibrate again: " +
                                    *calibration_problem_);
  if (auto latest = store_.latest_calibration()) return *std::move(latest);
  throw RpcError(rpc_refused, "there is no calibration yet");
}

void Daemon::tick() {
  ticker_.after(tick_period);
  follow([&] { keeper_.catch_up(); });
  if (session_.state() == SessionState::done) set_log_session({});
  judge_last_calibration();
  judge_trouble();
  resume_unsolved();
  if (cameras_are_warm(rig_.stats())) session_.cameras_became_warm();
  const Status now = status_now();
  tell_camera_faults(now.cameras, once_);
  if (now.sightings_dropped > 0)
    once_.warning("sightings", "sightings dropped, the estimator is too slow");
  pet_watchdog(now.cameras);
  take_next_config();
  panel_->show(now, access_.is_open(Access::Clock::now()));
  tell();
  keeper_.store_evidence();
}

/// Tells whoever listens, if there is something new.
void Daemon::tell() {
  const Status now = status_now();
  const Json told = essence(to_json(now));
  const auto clock = std::chrono::steady_clock::now();
  if (told == last_told_ && clock - last_told_at_ < heartbeat_period) return;
  if (told != last_told_)
    sd_notifyf(0, "STATUS=%s, %d throws", to_string(now.state).c_str(), now.throws);
  last_told_ = told;
  last_told_at_ = clock;
  link_.publish_status(to_json(now));
  if (http_) http_->publish_status(to_json(now));
}

Status Daemon::status_now() const {
  Status now = status_of(session_, rig_);
  now.fault = keeper_.fault() ? keeper_.fault() : camera_trouble_;
  now.calibration = keeper_.calibration_id();
  now.target = config_.rig.target;
  now.calibration_problem = calibration_problem_;
  if (can_) now.can = can_->status();
  now.uptime_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - began_).count();
  return now;
}

Json Daemon::status() const { return to_json(status_now()); }

Json Daemon::start_capture(bool ends_itself) {
  const SessionFacts facts{.unit = unit(),
                           .software = software_name(),
                           .started_utc = utc_now(),
                           .rig_toml = config_.text,
                           .cameras = camera_names(config_.rig),
                           .devices = devices_of(rig_.stats(), true)};
  const SessionGoal goal{.ends_itself = ends_itself, .min_throws = config_.target_throws};
  if (const auto refusal = keeper_.begin(facts, goal)) throw RpcError(rpc_refused, *refusal);
  if (cameras_are_warm(rig_.stats())) session_.cameras_became_warm();
  estimator_->begin_session(*session_.id());
  set_log_session(session_.id());
  log_info(Happening::session_began, "session " + std::to_string(*session_.id()) + " began");
  if (cameras_have_ended_)  // what they saw just before is all there will be
    follow([&] { session_.cameras_ended(); });
  return status();
}

Json Daemon::stop_capture() {
  follow([&] {
    if (const auto refusal = session_.stop()) throw RpcError(rpc_refused, *refusal);
  });
  return status();
}

Json Daemon::abort_capture() {
  const auto id = session_.id();
  if (const auto refusal = keeper_.abort()) throw RpcError(rpc_refused, *refusal);
  estimator_->abandon_session();
  log_info(Happening::session_aborted, "session " + std::to_string(*id) + " was thrown away");
  set_log_session({});
  return status();
}

Json Daemon::delete_session(std::int64_t session) {
  try {
    store_.delete_session(session);
  } catch (const StoreError& error) {
    throw RpcError(rpc_refused, error.what());
  }
  keeper_.forget(session);
  judged_devices_ = nullptr;
  log_info("session " + std::to_string(session) + " was deleted");
  return {{"deleted", session}};
}

std::string Daemon::unit() const { return config_.unit.empty() ? host_name() : config_.unit; }

void Daemon::authenticate(const std::string& token, JsonRpc::Caller& caller) {
  caller.knows_token = access_.knows(token);
  if (caller.knows_token) return;
  once_.warning("token", "a client showed a token that is not this box's");
  throw RpcError(rpc_forbidden, "this is not the box's token");
}

Json Daemon::hello() const {
  Json cameras = Json::array();
  for (const CameraDescription& camera : config_.rig.cameras) cameras.push_back(camera.name);
  return {{"software", software_name()},
          {"protocol", "throwcal/rpc/1"},
          {"schema", "throwcal/calibration/1"},
          {"unit", unit()},
          {"cameras", std::move(cameras)}};
}

Json Daemon::camera_list() const {
  Json out = Json::array();
  const std::vector<CameraStats> stats = rig_.stats();
  const Json devices = devices_of(stats, false);
  for (std::size_t i = 0; i < stats.size(); ++i) {
    const CameraModel& model = config_.rig.cameras[i].model;
    out.push_back({{"name", config_.rig.cameras[i].name},
                   {"source", config_.inputs[i].source},
                   {"width_px", model.width_px},
                   {"height_px", model.height_px},
                   {"lens", model.lens == Lens::kb4 ? "kb4" : "radtan"},
                   {"row_time_s", model.row_time_s},
                   {"running", stats[i].running},
                   {"frames_per_s", stats[i].frames_per_s},
                   {"device", devices.value(stats[i].name, Json())}});
  }
  return out;
}

Json Daemon::system_info() const {
  utsname names{};
  uname(&names);
  return {{"software", software_name()},
          {"unit", unit()},
          {"host", names.nodename},
          {"kernel", std::string(names.sysname) + " " + names.release},
          {"machine", names.machine},
          {"processors", sysconf(_SC_NPROCESSORS_ONLN)},
          {"pid", getpid()},
          {"uptime_s", status_now().uptime_s},
          {"utc", utc_now()},
          {"config", settings_.config_file.string()},
          {"state_dir", settings_.state_dir.string()},
          {"clients", link_.clients()},
          {"fault", keeper_.fault() ? Json(*keeper_.fault()) : Json(nullptr)}};
}

}  // namespace throwcal
