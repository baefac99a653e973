// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <filesystem>
#include <memory>
#include <optional>

#include "firmware/access.h"
#include "firmware/can_link.h"
#include "firmware/config.h"
#include "firmware/estimator_thread.h"
#include "firmware/event_loop.h"
#include "firmware/http_link.h"
#include "firmware/journal.h"
#include "firmware/json_rpc.h"
#include "firmware/news_box.h"
#include "firmware/panel.h"
#include "firmware/previews.h"
#include "firmware/session.h"
#include "firmware/session_keeper.h"
#include "firmware/status.h"
#include "firmware/store.h"
#include "firmware/tcp_link.h"
#include "firmware/watchdog.h"

namespace throwcal {

struct DaemonSettings {
  std::filesystem::path config_file, state_dir;
  std::filesystem::path port_file;       ///< if not empty: gets the TCP port once it is open
  std::filesystem::path http_port_file;  ///< likewise HTTP's
};

/// The box: cameras, estimator thread, session, store and link, wired together in one main loop.
/// All calls from the main thread.
class Daemon {
 public:
  /// Opens the store, the cameras and the link; throws InputError, StoreError or what a camera
  /// says. SIGTERM and SIGINT must be blocked by now.
  Daemon(const Config& config, DaemonSettings settings);
  ~Daemon();

  void run();  ///< until SIGTERM or SIGINT

  // What the links offer. They throw RpcError where it is not possible now.
  JsonRpc::Json hello() const;
  /// From now on the caller may change something; refused where it is not the box's token.
  void authenticate(const std::string& token, JsonRpc::Caller& caller);
  JsonRpc::Json status() const;
  /// `ends_itself`: once the target is reached.
  JsonRpc::Json start_capture(bool ends_itself = true);
  JsonRpc::Json stop_capture();
  JsonRpc::Json abort_capture();
  JsonRpc::Json delete_session(std::int64_t session);
  /// Refused where cables were swapped, or another camera or size is there, since it was made.
  JsonRpc::Json latest_calibration();
  JsonRpc::Json camera_list() const;
  JsonRpc::Json system_info() const;
  const Store& store() const { return store_; }
  /// Of a session that is over; nothing of others. Refused where it is not whole.
  std::optional<std::filesystem::path> session_file(std::int64_t session) const;

 private:
  void resume_unsolved();
  void end_capture();
  void take_news();
  void follow(const std::function<void()>& change);
  void judge_last_calibration();
  void judge_trouble();
  std::filesystem::path token_file() const;
  bool obey(Press press);  ///< false: not possible now. (daemon_button.cpp)
  void reset_access();
  void reload();  ///< (daemon_reload.cpp)
  void take_over(Config next);
  void take_next_config();
  void pet_watchdog(const std::vector<CameraStats>& cameras);  ///< (daemon_watchdog.cpp)
  void tick();
  void tell();
  void shut_down();
  Status status_now() const;
  std::string unit() const;
  void open_http();
  std::string metrics();

  Config config_;
  std::optional<Config> next_config_;  ///< taken when no session is under way
  const DaemonSettings settings_;
  const std::chrono::steady_clock::time_point began_ = std::chrono::steady_clock::now();
  EventLoop loop_;
  LogOnce once_;
  Store store_;
  Access access_;
  Rig rig_;
  Session session_;
  SessionKeeper keeper_;
  NewsBox news_;
  JsonRpc rpc_;
  TcpLink link_;
  std::optional<std::string> camera_trouble_, calibration_problem_;
  std::optional<CanLink> can_;
  Previews previews_;
  std::optional<HttpLink> http_;
  JsonRpc::Json judged_devices_;  ///< with which calibration_problem_ was found; null: not yet
  std::optional<std::int64_t> judged_calibration_;
  bool has_resumed_ = false;
  bool cameras_have_ended_ = false;
  std::chrono::steady_clock::time_point ended_itself_{};  ///< when a session last did
  std::optional<EstimatorThread> estimator_;
  std::optional<Panel> panel_;
  Movement movement_;
  const std::optional<std::chrono::microseconds> watchdog_period_ = watchdog_period();
  std::chrono::steady_clock::time_point petted_{};
  EventLoop::Source term_, interrupt_, hang_up_, news_source_, ticker_;
  JsonRpc::Json last_told_;
  std::chrono::steady_clock::time_point last_told_at_{};
};

/// The methods of the contract, each a line. (rpc_methods.cpp)
void add_methods(JsonRpc& rpc, Daemon& daemon);

}  // namespace throwcal
