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
#include "firmware/cameras.h"
#include "firmware/export.h"
#include "firmware/text_file.h"

namespace throwcal {
namespace {

using namespace std::chrono_literals;

constexpr auto tick_period = 100ms;        // notifications come at most this often
constexpr auto heartbeat_period = 1000ms;  // counters alone are told this often
/// How long the stop waits for the estimator.
constexpr auto estimator_patience = 500ms;
/// Frames after which a detector surely knows its background.
constexpr std::uint64_t warm_frames = 30;

/// Behind the cameras' threads: however busy clients or a calibration keep the processor, pictures
/// come first. Threads made later inherit it.
constexpr int niceness = 10;

std::string host_name() {
  utsname names{};
  uname(&names);
  return names.nodename;
}

/// A status without what changes all the time: is it worth telling at once?
Json essence(Json status) {
  status.erase("uptime_s");
  for (Json& camera : status["cameras"])
    for (const char* counter : {"frames", "frames_per_s", "sightings", "time_sigma_s"})
      camera.erase(counter);
  return status;
}

}  // namespace

Daemon::Daemon(const Config& config, DaemonSettings settings)
    : config_(config),
      settings_(std::move(settings)),
      store_(settings_.state_dir, config_.rig),
      access_(token_in(config_.token_file.value_or(settings_.state_dir / "token"))),
      rig_(open_rig(config_, log_warning)),
      session_(config_.rig.cameras.size()),
      rpc_([this] { return access_.is_open(Access::Clock::now()); }),
      link_(loop_, config_.listen, rpc_, [this] { return hello(); }) {
  add_methods(rpc_, *this);
  term_ = loop_.on_signal(SIGTERM, [this] { loop_.quit(); });
  interrupt_ = loop_.on_signal(SIGINT, [this] { loop_.quit(); });
  news_source_ = loop_.on_io(news_.fd(), EPOLLIN, [this](std::uint32_t) { read_news(); });
  ticker_ = loop_.on_timer(tick_period, [this] { tick(); });
  loop_.serve_watchdog();
}

Daemon::~Daemon() = default;

void Daemon::run() {
  rig_.start();
  setpriority(PRIO_PROCESS, 0, niceness);  // on Linux, of the calling thread only
  estimator_.emplace(config_.rig, rig_, news_, config_.pre_trigger);
  resume_unsolved();
  if (!settings_.port_file.empty())
    write_text_file(settings_.port_file, std::to_string(link_.port()) + "\n");
  const std::string listening =
      "listening at " + config_.listen.host + ":" + std::to_string(link_.port());
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
  const bool ended = estimator_->stop_within(estimator_patience);
  read_news();
  rig_.stop();
  log_info("stopped in state " + to_string(session_.state()));
  if (!ended) std::_Exit(0);  // the estimator is at it still; its flights are on the disk
}

void Daemon::resume_unsolved() {
  auto unsolved = store_.unsolved_session();
  if (!unsolved) return;
  log_info("session " + std::to_string(unsolved->session) + " was interrupted; solving its " +
           std::to_string(unsolved->flights.size()) + " flights");
  std::vector<CameraId> cameras;
  for (const Track& flight : unsolved->flights) cameras.push_back(flight.camera);
  session_.resume_solving(unsolved->session, cameras);
  store_.stop_session(unsolved->session, utc_now());
  estimator_->solve(std::move(unsolved->flights));
}

/// Runs what writes to the store; a failure is the box's fault, shown until a write succeeds.
template <typename Work>
bool Daemon::stored(const Work& work) {
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

void Daemon::read_news() {
  const News news = news_.take();
  keep(news);
  for (const Track& flight : news.flights) session_.flight_found(flight.camera);
  if (news.flights_dropped > 0)
    once_.warning("flights", std::to_string(news.flights_dropped) +
                                 " flights were lost: the main loop was too slow");
  if (news.calibration) session_.calibrated(news.throws, news.calibration);
  if (news.solved) session_.solved();
  if (news.cameras_ended) {
    log_warning("every camera has ended");
    if (session_.is_watching()) stop_capture();
  }
}

void Daemon::keep(const News& news) {
  if (!session_.id()) return;
  const std::int64_t id = *session_.id();
  stored([&] {
    store_.add_flights(id, news.flights);
    if (news.calibration) {
      Json document = to_json(*news.calibration, utc_now());
      add_devices(document, devices_of_session());
      store_.put_calibration(id, document, news.throws);
      judged_devices_ = nullptr;
    }
    if (news.solved) store_.finish_session(id);
  });
}

bool Daemon::cameras_are_warm() const {
  return std::ranges::all_of(rig_.stats(), [](const CameraStats& camera) {
    return !camera.running || !camera.error.empty() || camera.frames >= warm_frames;
  });
}

/// What was behind the cameras when the session began, and of those that came later since then.
Json Daemon::devices_of_session() const {
  Json devices = store_.devices(*session_.id());
  if (began_here_ != session_.id()) return devices;
  const Json now = devices_of(rig_.stats(), true);
  for (const auto& [name, device] : now.items())
    if (!devices.contains(name)) devices[name] = device;
  return devices;
}

/// Whether the last calibration is that of the cameras as they are now, looked into again only when
/// one of both has changed.
void Daemon::judge_last_calibration() {
  Json devices = devices_of(rig_.stats(), false);
  if (devices == judged_devices_) return;
  std::optional<Json> latest;
  try {
    latest = store_.latest_calibration();
  } catch (const StoreError& error) {
    once_.warning("store", error.what());
    return;
  }
  calibration_problem_.reset();
  if (latest)
    for (const std::string& change : camera_changes(*latest, devices))
      calibration_problem_ = (calibration_problem_ ? *calibration_problem_ + "; " : "") + change;
  if (calibration_problem_)
    log_warning("the last calibration is not of these cameras: " + *calibration_problem_);
  judged_devices_ = std::move(devices);
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
  judge_last_calibration();
  if (cameras_are_warm()) session_.cameras_became_warm();
  const Status now = status_now();
  tell_camera_faults(now);
  const Json told = essence(to_json(now));
  const auto clock = std::chrono::steady_clock::now();
  if (told == last_told_ && clock - last_told_at_ < heartbeat_period) return;
  if (told != last_told_)
    sd_notifyf(0, "STATUS=%s, %d throws", to_string(now.state).c_str(), now.throws);
  last_told_ = told;
  last_told_at_ = clock;
  link_.publish_status(to_json(now));
}

void Daemon::tell_camera_faults(const Status& now) {
  for (const CameraStats& camera : now.cameras) {
    if (camera.error.empty() && camera.running)
      once_.forget("camera " + camera.name);
    else if (!camera.error.empty())
      once_.warning("camera " + camera.name, "camera \"" + camera.name + "\": " + camera.error);
    if (camera.frames_dropped > 0)
      once_.warning("drops " + camera.name,
                    "camera \"" + camera.name + "\": frames dropped, the detector is too slow");
    if (camera.frames_damaged > 0)
      once_.warning("damaged " + camera.name,
                    "camera \"" + camera.name + "\": frames damaged; a loose cable?");
    if (camera.settings.set_back > 0)
      once_.warning("set back " + camera.name,
                    "camera \"" + camera.name +
                        "\": another program changed its exposure, gain, "
                        "focus or white balance; set back");
    if (!camera.settings.automatic.empty())
      once_.warning("automatic " + camera.name,
                    "camera \"" + camera.name + "\": its " + camera.settings.automatic.front() +
                        " is automatic; a picture that changes is measured worse");
    if (camera.frames_lost_by_driver > 0)
      once_.warning("gaps " + camera.name,
                    "camera \"" + camera.name + "\": frames lost before they reached the box");
  }
  if (now.sightings_dropped > 0)
    once_.warning("sightings", "sightings dropped, the estimator is too slow");
}

Status Daemon::status_now() const {
  Status now = status_of(session_, rig_);
  now.fault = fault_;
  now.calibration_problem = calibration_problem_;
  now.uptime_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - began_).count();
  return now;
}

Json Daemon::status() const { return to_json(status_now()); }

Json Daemon::start_capture() {
  Session next = session_;
  if (const auto refusal = next.start(0, cameras_are_warm())) throw RpcError(rpc_refused, *refusal);
  std::int64_t id = 0;
  if (!stored([&] { id = store_.start_session(utc_now(), devices_of(rig_.stats(), true)); }))
    throw RpcError(rpc_refused, *fault_);
  (void)session_.start(id, cameras_are_warm());
  began_here_ = id;
  estimator_->begin_session();
  log_info("session " + std::to_string(id) + " began");
  return status();
}

Json Daemon::stop_capture() {
  Session next = session_;
  if (const auto refusal = next.stop()) throw RpcError(rpc_refused, *refusal);
  const std::int64_t id = *session_.id();
  if (!stored([&] { store_.stop_session(id, utc_now()); })) throw RpcError(rpc_refused, *fault_);
  session_ = next;
  estimator_->finish_session();
  log_info("session " + std::to_string(id) + " ended; solving");
  return status();
}

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
          {"unit", config_.unit.empty() ? host_name() : config_.unit},
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
          {"unit", config_.unit.empty() ? host_name() : config_.unit},
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
          {"fault", fault_ ? Json(*fault_) : Json(nullptr)}};
}

}  // namespace throwcal
