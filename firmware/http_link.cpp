// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/http_link.h"

#include <microhttpd.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>

#include "firmware/input_error.h"

namespace throwcal {
namespace {

using namespace std::chrono_literals;
using Clock = NewestStream::Clock;

constexpr std::size_t memory_bytes = 32 * 1024;  ///< of a connection: its headers, too
constexpr int send_buffer_bytes = 64 * 1024;     ///< so that a slow reader's news is not old
constexpr std::size_t stream_block_bytes = 16 * 1024, file_block_bytes = 64 * 1024;
constexpr std::size_t most_thrown_away_bytes = 1024 * 1024;
constexpr std::chrono::microseconds calm_tick = 1s, picture_tick = 100ms;
constexpr std::chrono::milliseconds picture_again = 5s, no_timeout = 1h;

NewestStream::Message message(std::string text) {
  return std::make_shared<const std::string>(std::move(text));
}

NewestStream::Message status_event(const JsonRpc::Json& status) {
  return message("event: status\ndata: " + JsonRpc::to_line(status) + "\n\n");
}

/// The boundary stands behind a picture, too: browsers show one when they see its end.
NewestStream::Message picture_part(const Preview& preview, bool is_first) {
  const std::string balls = preview.balls.empty() ? "" : "X-Balls: " + preview.balls + "\r\n";
  return message((is_first ? "--throwcal\r\n" : "") + ("Content-Type: image/jpeg\r\n" + balls) +
                 "Content-Length: " + std::to_string(preview.jpeg.size()) + "\r\n\r\n" +
                 preview.jpeg + "\r\n--throwcal\r\n");
}

std::optional<std::string> header(MHD_Connection* connection, const char* name) {
  const char* value = MHD_lookup_connection_value(connection, MHD_HEADER_KIND, name);
  return value ? std::optional<std::string>(value) : std::nullopt;
}

HttpHeaders headers_of(MHD_Connection* connection) {
  return {.authorization = header(connection, "Authorization"),
          .idempotency_key = header(connection, "Idempotency-Key"),
          .if_none_match = header(connection, "If-None-Match"),
          .origin = header(connection, "Origin"),
          .host = header(connection, "Host")};
}

bool announces_too_much(MHD_Connection* connection) {
  const std::string length = header(connection, "Content-Length").value_or("0");
  std::uint64_t bytes = 0;
  const auto [end, error] = std::from_chars(length.data(), length.data() + length.size(), bytes);
  return error != std::errc{} || bytes > HttpRoutes::most_body_bytes;
}

/// It has closed, or nothing of it can be reached any more.
bool has_left(int fd) {
  char byte = 0;
  const ssize_t count = recv(fd, &byte, 1, MSG_PEEK | MSG_DONTWAIT);
  return count == 0 || (count < 0 && errno != EAGAIN && errno != EINTR);
}

HttpReply too_large() {
  return error_reply(
      http_too_large, rpc_invalid_request,
      "a body holds " + std::to_string(HttpRoutes::most_body_bytes >> 10) + " KiB at most");
}

HttpReply too_many(const std::string& what) {
  HttpReply reply = error_reply(http_unavailable, rpc_refused,
                                "the box serves " + what + " at most; try again later");
  reply.headers.emplace_back("Retry-After", "5");
  return reply;
}

}  // namespace

struct HttpLink::Connection {
  HttpLink& link;
  MHD_Connection* handle = nullptr;
  int fd = -1;
  bool is_refused = false;  ///< over the limit: only there to be told so
  bool is_begun = false;    ///< the headers of a request are there
  HttpRequest request{};
  std::size_t body_bytes = 0;                   ///< those thrown away, too
  Clock::time_point since = Clock::now();       ///< the last request was done
  std::optional<NewestStream> stream{};         ///< its answer is one
  std::optional<CameraId> camera{};             ///< of the stream; nothing: the status
  std::shared_ptr<const Preview> last_shown{};  ///< of the camera
  std::optional<HttpReply> reply{};             ///< until it is queued: there is work in it
  std::uint64_t last_turn = 0;                  ///< when some of that was done
  std::shared_ptr<const OutgoingFile> file{};   ///< its answer is, or will be, one
  bool is_suspended = false;  ///< the stream waits for something to tell, or there is work to do

  /// Without a listening socket of its own, libmicrohttpd's descriptor does not tell of this.
  void wake() {
    if (!std::exchange(is_suspended, false)) return;
    MHD_resume_connection(handle);
    if (!link.is_ending_) link.timeout_.after(0ms);
  }
};

struct HttpLink::Callbacks {
  static void connection(void* self, MHD_Connection* handle, void** context,
                         MHD_ConnectionNotificationCode code) {
    auto& link = *static_cast<HttpLink*>(self);
    if (code == MHD_CONNECTION_NOTIFY_CLOSED) {
      link.connections_.remove_if([&](const Connection& c) { return c.handle == handle; });
      return;
    }
    const bool is_refused = link.connections() >= link.settings_.max_connections;
    if (is_refused)
      link.once_.warning("connections", "more than " +
                                            std::to_string(link.settings_.max_connections) +
                                            " HTTP connections: further ones are refused");
    const int fd = MHD_get_connection_info(handle, MHD_CONNECTION_INFO_CONNECTION_FD)->connect_fd;
    *context = &link.connections_.emplace_back(
        Connection{.link = link, .handle = handle, .fd = fd, .is_refused = is_refused});
  }

  static Connection& of(MHD_Connection* handle) {
    return *static_cast<Connection*>(
        MHD_get_connection_info(handle, MHD_CONNECTION_INFO_SOCKET_CONTEXT)->socket_context);
  }

  /// As it stands in the request line: libmicrohttpd's own decoding ends at a NUL.
  static void* target(void*, const char* uri, MHD_Connection* handle) {
    of(handle).request.target = uri;
    return nullptr;
  }

  /// First with the headers, then with each piece of the body, then once more.
  static MHD_Result request(void* self, MHD_Connection* handle, const char*, const char* method,
                            const char*, const char* piece, std::size_t* size, void**) {
    Connection& connection = of(handle);
    HttpLink& link = *static_cast<HttpLink*>(self);
    if (!std::exchange(connection.is_begun, true)) {
      connection.request.method = method;
      connection.request.headers = headers_of(handle);
      if (announces_too_much(handle)) link.queue(connection, too_large());
      return MHD_YES;
    }
    if (*size == 0) return link.conclude(connection) ? MHD_YES : MHD_NO;
    connection.body_bytes += *size;
    if (connection.body_bytes <= HttpRoutes::most_body_bytes)
      connection.request.body.append(piece, *size);
    *size = 0;
    return connection.body_bytes > most_thrown_away_bytes ? MHD_NO : MHD_YES;
  }

  static void completed(void*, MHD_Connection* handle, void**, MHD_RequestTerminationCode) {
    Connection& connection = of(handle);
    connection.is_begun = false;
    connection.request = {};
    connection.body_bytes = 0;
    connection.stream.reset();
    connection.camera.reset();
    connection.last_shown.reset();
    connection.reply.reset();
    connection.file.reset();
    connection.since = Clock::now();
  }

  /// A file that was written to meanwhile ends before its end: nobody takes that for the whole.
  static ssize_t read_file(void* context, std::uint64_t offset, char* out, std::size_t most) {
    const auto count = static_cast<Connection*>(context)->file->read(offset, {out, most});
    return count ? static_cast<ssize_t>(*count) : MHD_CONTENT_READER_END_WITH_ERROR;
  }

  static ssize_t read(void* context, std::uint64_t, char* out, std::size_t most) {
    auto& connection = *static_cast<Connection*>(context);
    if (connection.link.is_ending_) return MHD_CONTENT_READER_END_OF_STREAM;
    if (has_left(connection.fd)) return MHD_CONTENT_READER_END_WITH_ERROR;
    const std::size_t count = connection.stream->read({out, most});
    if (count == 0) {
      connection.is_suspended = true;
      MHD_suspend_connection(connection.handle);
    }
    return static_cast<ssize_t>(count);
  }
};

HttpLink::HttpLink(EventLoop& loop, const ListenAddress& address, JsonRpc& rpc, HttpSources sources,
                   HttpLinkSettings settings)
    : rpc_(rpc),
      sources_(std::move(sources)),
      routes_(rpc, sources_),
      settings_(settings),
      daemon_(
          MHD_start_daemon(
              MHD_USE_EPOLL | MHD_USE_NO_LISTEN_SOCKET | MHD_ALLOW_SUSPEND_RESUME, 0, nullptr,
              nullptr, &Callbacks::request, this, MHD_OPTION_CONNECTION_MEMORY_LIMIT, memory_bytes,
              MHD_OPTION_CONNECTION_LIMIT, static_cast<unsigned>(2 * settings.max_connections),
              MHD_OPTION_CONNECTION_TIMEOUT, static_cast<unsigned>(settings.idle.count()),
              MHD_OPTION_STRICT_FOR_CLIENT, 1, MHD_OPTION_NOTIFY_CONNECTION, &Callbacks::connection,
              this, MHD_OPTION_NOTIFY_COMPLETED, &Callbacks::completed, nullptr,
              MHD_OPTION_URI_LOG_CALLBACK, &Callbacks::target, nullptr,
              MHD_OPTION_SIGPIPE_HANDLED_BY_APP, 1, MHD_OPTION_END),
          MHD_stop_daemon),
      listener_(loop, address, [this](const ListenSocket::Peer& peer) { accept(peer); }) {
  if (!daemon_) throw InputError("can't serve HTTP: libmicrohttpd does not start");
  const auto* info = MHD_get_daemon_info(daemon_.get(), MHD_DAEMON_INFO_EPOLL_FD);
  io_ = loop.on_io(info->epoll_fd, EPOLLIN, [this](std::uint32_t) { run(); });
  timeout_ = loop.on_timer(no_timeout, [this] { run(); });
  ticker_ = loop.on_timer(calm_tick, [this] { tick(); });
  worker_ = loop.on_timer(no_timeout, [this] { work(); });
}

/// The loop has ended: what the kernel takes at once is sent, and nobody waited for.
HttpLink::~HttpLink() {
  is_ending_ = true;
  for (Connection& connection : connections_) connection.wake();
  for (int i = 0; i < 3; ++i) MHD_run(daemon_.get());  // resume; last chunk; farewell
  io_ = {};
}

std::size_t HttpLink::connections() const {
  return static_cast<std::size_t>(std::ranges::count(connections_, false, &Connection::is_refused));
}

std::size_t HttpLink::streams() const {
  return static_cast<std::size_t>(
      std::ranges::count_if(connections_, [](const Connection& c) { return c.stream || c.file; }));
}

/// libmicrohttpd does not look at a stream that waits, and overlooks who closes right behind half a
/// request (it watches for edges): their places would stay taken.
void HttpLink::drop_who_left() {
  for (Connection& connection : connections_) {
    const bool may_go = (connection.is_suspended && !connection.reply) || !connection.is_begun;
    if (!may_go || !has_left(connection.fd)) continue;
    connection.wake();
    shutdown(connection.fd, SHUT_RDWR);  // an edge
  }
}

void HttpLink::accept(const ListenSocket::Peer& peer) {
  if (connections_.size() >= settings_.max_connections) {
    drop_who_left();
    run();
  }
  if (connections_.size() >= 2 * settings_.max_connections) {  // too many even to be told so
    close(peer.fd);
    return;
  }
  setsockopt(peer.fd, SOL_SOCKET, SO_SNDBUF, &send_buffer_bytes, sizeof send_buffer_bytes);
  MHD_add_connection(daemon_.get(), peer.fd, reinterpret_cast<const sockaddr*>(&peer.address),
                     peer.address_size);  // closes it where it fails
  run();
}

void HttpLink::run() {
  MHD_run(daemon_.get());
  MHD_UNSIGNED_LONG_LONG ms = 0;
  const bool has_timeout = MHD_get_timeout(daemon_.get(), &ms) == MHD_YES;
  const auto most = static_cast<MHD_UNSIGNED_LONG_LONG>(no_timeout.count());
  timeout_.after(std::chrono::milliseconds(has_timeout ? std::min(ms, most) : most));
}

HttpReply HttpLink::answer(Connection& connection) {
  if (connection.is_refused)
    return too_many(std::to_string(settings_.max_connections) + " connections");
  if (connection.body_bytes > HttpRoutes::most_body_bytes) return too_large();
  return routes_.reply(connection.request);
}

/// The answer is queued, or waits until the work in it is done. False: there is none, the end came
/// first.
bool HttpLink::conclude(Connection& connection) {
  if (!connection.reply) connection.reply = answer(connection);
  HttpReply& reply = *connection.reply;
  const bool needs_place = reply.stream || (reply.file && !connection.file);
  if (needs_place && streams() >= settings_.max_streams)
    reply = too_many(std::to_string(settings_.max_streams) + " streams and files");
  connection.file = reply.file;
  if (!reply.work) {
    queue(connection, *std::exchange(connection.reply, std::nullopt));
    return true;
  }
  if (is_ending_) return false;
  connection.is_suspended = true;
  MHD_suspend_connection(connection.handle);
  worker_.after(0ms);
  return true;
}

/// A little, for whoever has waited longest; then everything else has its turn.
void HttpLink::work() {
  Connection* next = nullptr;
  for (Connection& connection : connections_)
    if (connection.is_suspended && connection.reply &&
        (!next || connection.last_turn < next->last_turn))
      next = &connection;
  if (!next) return;
  next->last_turn = ++turns_;
  next->reply = routes_.further(*next->reply);
  if (!next->reply->work) next->wake();
  worker_.after(0ms);
}

MHD_Response* HttpLink::begin_response(Connection& connection, const HttpReply& reply) {
  if (reply.file)
    return MHD_create_response_from_callback(reply.file->bytes(), file_block_bytes,
                                             &Callbacks::read_file, &connection, nullptr);
  if (!reply.stream || connection.request.method == "HEAD")
    return MHD_create_response_from_buffer(
        reply.body->size(), const_cast<char*>(reply.body->data()), MHD_RESPMEM_MUST_COPY);
  begin_stream(connection, *reply.stream);
  return MHD_create_response_from_callback(MHD_SIZE_UNKNOWN, stream_block_bytes, &Callbacks::read,
                                           &connection, nullptr);
}

void HttpLink::queue(Connection& connection, const HttpReply& reply) {
  MHD_Response* response = begin_response(connection, reply);
  if (!response) return;  // no memory: without an answer the connection is closed
  if (reply.status != http_not_modified)
    MHD_add_response_header(response, "Content-Type", reply.content_type.c_str());
  for (const auto& [name, value] : reply.headers)
    MHD_add_response_header(response, name.c_str(), value.c_str());
  if (connection.is_refused) MHD_add_response_header(response, "Connection", "close");
  MHD_queue_response(connection.handle, reply.status, response);
  MHD_destroy_response(response);
}

void HttpLink::begin_stream(Connection& connection, const HttpStream& stream) {
  connection.stream.emplace(Clock::now());
  connection.camera = stream.camera;
  if (stream.camera) return ticker_.after(0ms);
  JsonRpc::Caller nobody;
  offer(connection, status_event(rpc_.call("status.get", JsonRpc::Json::object(), nobody)));
}

void HttpLink::offer(Connection& connection, NewestStream::Message what) {
  connection.stream->offer(std::move(what), Clock::now());
  connection.wake();
}

void HttpLink::publish_status(const JsonRpc::Json& status) {
  NewestStream::Message event;
  for (Connection& connection : connections_) {
    if (!connection.stream || connection.camera) continue;
    if (!event) event = status_event(status);
    offer(connection, event);
  }
}

/// One that sends or reads a byte now and then is not idle.
bool HttpLink::takes_too_long(const Connection& connection, Clock::time_point now) const {
  if (connection.stream) return false;
  const std::uint64_t bytes = connection.file ? connection.file->bytes() : 0;
  return now - connection.since >
         settings_.request + std::chrono::seconds(bytes / settings_.slowest_bytes_per_s);
}

void HttpLink::tick() {
  drop_who_left();
  const auto now = Clock::now();
  std::set<CameraId> looked_at;
  for (Connection& connection : connections_) {
    if (takes_too_long(connection, now))
      shutdown(connection.fd, SHUT_RDWR);  // libmicrohttpd closes it then
    if (connection.stream && connection.camera) looked_at.insert(*connection.camera);
    if (connection.stream && !connection.camera && connection.stream->is_empty() &&
        now - connection.stream->offered_at() > settings_.heartbeat)
      offer(connection, message(": heartbeat\n\n"));
  }
  if (looked_at.empty()) return ticker_.after(calm_tick);
  show_next(looked_at, now);
  ticker_.after(picture_tick / looked_at.size());
}

/// To those who look at one camera: so at most one picture is made in one turn of the loop.
void HttpLink::show_next(const std::set<CameraId>& looked_at, Clock::time_point now) {
  auto camera = looked_at.upper_bound(last_shown_);
  if (camera == looked_at.end()) camera = looked_at.begin();
  last_shown_ = *camera;
  for (Connection& connection : connections_)
    if (connection.stream && connection.camera == *camera && connection.stream->is_empty())
      show_camera(connection, now);
}

/// A picture that it has not had yet; the last one again where none comes, or nobody would notice
/// that the reader has left.
void HttpLink::show_camera(Connection& connection, Clock::time_point now) {
  const auto preview = sources_.preview(*connection.camera);
  const bool is_new = preview != connection.last_shown;
  if (!preview || (!is_new && now - connection.stream->offered_at() < picture_again)) return;
  offer(connection, picture_part(*preview, !connection.last_shown));
  connection.last_shown = preview;
}

}  // namespace throwcal
