// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <functional>
#include <list>
#include <memory>
#include <set>

#include "firmware/event_loop.h"
#include "firmware/http_routes.h"
#include "firmware/journal.h"
#include "firmware/listen_socket.h"
#include "firmware/newest_stream.h"

struct MHD_Daemon;
struct MHD_Connection;
struct MHD_Response;

namespace throwcal {

struct HttpLinkSettings {
  std::size_t max_connections = 16;
  std::size_t max_streams = 12;      ///< of them, files too: so that a question is still answered
  std::chrono::seconds idle{15};     ///< a connection on which nothing moves is closed
  std::chrono::seconds request{60};  ///< so long may a request and its answer take together
  std::uint64_t slowest_bytes_per_s = 16 * 1024;  ///< so much longer may a file take
  std::chrono::seconds heartbeat{10};  ///< in a stream of events that has nothing to tell
};

/// HTTP/1.1 by libmicrohttpd, all in the main loop: nothing a client does or fails to do makes
/// anybody wait.
class HttpLink {
 public:
  /// Listens. Throws InputError naming address and cause where it can't.
  HttpLink(EventLoop& loop, const ListenAddress& address, JsonRpc& rpc, HttpSources sources,
           HttpLinkSettings settings = {});
  ~HttpLink();  ///< ends the streams

  int port() const { return listener_.port(); }
  std::size_t connections() const;
  /// To all who read the events; who reads slowly gets the newest only.
  void publish_status(const JsonRpc::Json& status);

 private:
  struct Connection;
  struct Callbacks;  ///< what libmicrohttpd calls

  void accept(const ListenSocket::Peer& peer);
  void drop_who_left();
  void run();
  void tick();
  HttpReply answer(Connection& connection);
  bool conclude(Connection& connection);
  void work();
  void queue(Connection& connection, const HttpReply& reply);
  MHD_Response* begin_response(Connection& connection, const HttpReply& reply);
  void begin_stream(Connection& connection, const HttpStream& stream);
  void offer(Connection& connection, NewestStream::Message message);
  void show_next(const std::set<CameraId>& looked_at, NewestStream::Clock::time_point now);
  void show_camera(Connection& connection, NewestStream::Clock::time_point now);
  bool takes_too_long(const Connection& connection, NewestStream::Clock::time_point now) const;
  std::size_t streams() const;

  JsonRpc& rpc_;
  HttpSources sources_;
  HttpRoutes routes_;
  HttpLinkSettings settings_;
  LogOnce once_;
  std::list<Connection> connections_;
  bool is_ending_ = false;
  std::uint64_t turns_ = 0;  ///< of those for whom work is done
  CameraId last_shown_ = 0;  ///< the camera whose streams had the last turn
  std::unique_ptr<MHD_Daemon, void (*)(MHD_Daemon*)> daemon_;
  EventLoop::Source io_, timeout_, ticker_, worker_;
  ListenSocket listener_;
};

}  // namespace throwcal
