// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/tcp_link.h"

#include <netdb.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>

namespace throwcal {
namespace {

using namespace std::chrono_literals;
constexpr auto farewell_time = 2s;

std::string host_of(const ListenSocket::Peer& peer) {
  char host[NI_MAXHOST] = "?";
  getnameinfo(reinterpret_cast<const sockaddr*>(&peer.address), peer.address_size, host,
              sizeof host, nullptr, 0, NI_NUMERICHOST);
  return host;
}

}  // namespace

struct TcpLink::Client {
  int fd = -1;
  std::string host;
  std::string input, output;  ///< a line not yet whole; bytes not yet taken by the kernel
  JsonRpc::Caller caller;
  std::optional<std::string> newest_status;  ///< to be sent when `output` is empty
  bool refused = false;                      ///< over the limit: only there to be told so
  bool leaving = false;                      ///< what it sends is thrown away
  bool half_closed = false;                  ///< it will send no more
  bool gone = false;
  EventLoop::Source io, farewell_timer;

  ~Client() {
    io = {};
    close(fd);
  }
};

TcpLink::TcpLink(EventLoop& loop, const ListenAddress& address, JsonRpc& rpc,
                 std::function<JsonRpc::Json()> hello, TcpLinkSettings settings)
    : loop_(loop),
      rpc_(rpc),
      hello_(std::move(hello)),
      settings_(settings),
      listener_(loop, address, [this](const ListenSocket::Peer& peer) { greet(peer); }) {}

TcpLink::~TcpLink() {
  for (const auto& client : clients_) write_out(*client);  // the loop has ended: no waiting
  clients_.clear();
}

std::size_t TcpLink::clients() const {
  return static_cast<std::size_t>(
      std::ranges::count_if(clients_, [](const auto& c) { return !c->refused && !c->gone; }));
}

void TcpLink::forget_tokens() {
  for (const auto& client : clients_) client->caller.knows_token = false;
}

void TcpLink::greet(const ListenSocket::Peer& peer) {
  if (clients_.size() >= 2 * settings_.max_clients) {  // too many even to be told so
    close(peer.fd);
    return;
  }
  const bool refused = clients() >= settings_.max_clients;
  Client& client = *clients_.emplace_back(std::make_unique<Client>());
  client.fd = peer.fd;
  client.host = host_of(peer);
  client.refused = refused;
  client.io = loop_.on_io(peer.fd, EPOLLIN,
                          [this, &client](std::uint32_t events) { serve(client, events); });
  if (!refused) return send(client, JsonRpc::to_line(JsonRpc::notification("hello", hello_())));
  once_.warning("clients", "more than " + std::to_string(settings_.max_clients) +
                               " clients: further ones are refused");
  farewell(client, rpc_refused,
           "the box serves " + std::to_string(settings_.max_clients) +
               " clients at most; try again when one has left");
}

void TcpLink::serve(Client& client, std::uint32_t events) {
  if (events & EPOLLOUT) flush(client);
  if (events & (EPOLLIN | EPOLLHUP | EPOLLERR) && !client.half_closed) read(client);
  if ((events & (EPOLLHUP | EPOLLERR)) && client.half_closed) client.gone = true;
  sweep();
}

void TcpLink::sweep() {
  std::erase_if(clients_, [](const auto& client) { return client->gone; });
}

void TcpLink::read(Client& client) {
  char block[64 * 1024];  // one a round: others have their turn
  const ssize_t count = recv(client.fd, block, sizeof block, 0);
  if (count < 0 && (errno == EAGAIN || errno == EINTR)) return;
  if (count < 0) client.gone = true;
  if (count == 0) hang_up(client);
  if (count <= 0 || client.leaving) return;
  client.input.append(block, static_cast<std::size_t>(count));
  take_lines(client);
}

/// It sends no more; what it asked for is still answered.
void TcpLink::hang_up(Client& client) {
  if (!client.input.empty() && !client.leaving)
    once_.warning("half " + client.host,
                  "client " + client.host + " left in the middle of a request; dropped");
  client.half_closed = true;
  client.leaving = true;
  client.caller.subscribed_to_status = false;
  client.farewell_timer = loop_.on_timer(farewell_time, [this, &client] {
    client.gone = true;
    sweep();
  });
  flush(client);
}

void TcpLink::take_lines(Client& client) {
  std::size_t begin = 0;
  while (!client.leaving && !client.gone) {
    const std::size_t end = client.input.find('\n', begin);
    const std::size_t length = std::min(end, client.input.size()) - begin;
    if (length > settings_.max_line_bytes) {
      once_.warning("oversize " + client.host,
                    "client " + client.host + " sent an oversize line; connection closed");
      return farewell(client, rpc_invalid_request,
                      "a line holds " + std::to_string(settings_.max_line_bytes) +
                          " bytes at most; connection closed");
    }
    if (end == std::string::npos) break;
    std::string_view line(client.input.data() + begin, length);
    begin = end + 1;
    if (line.ends_with('\r')) line.remove_suffix(1);
    if (line.find_first_not_of(" \t") == line.npos) continue;
    if (const auto answer = rpc_.answer(line, client.caller)) send(client, *answer);
  }
  client.input.erase(0, begin);
}

void TcpLink::send(Client& client, const std::string& line) {
  if (client.output.size() > settings_.max_output_bytes) {
    once_.warning("slow " + client.host, "client " + client.host + " does not read: more than " +
                                             std::to_string(settings_.max_output_bytes) +
                                             " bytes wait for it; connection closed");
    client.gone = true;
    return;
  }
  client.output += line;
  client.output += '\n';
  flush(client);
}

/// As much as the kernel takes; the newest status follows what was before it.
void TcpLink::write_out(Client& client) {
  if (client.output.empty() && client.newest_status) {
    client.output = *client.newest_status + '\n';
    client.newest_status.reset();
  }
  if (client.output.empty()) return;
  const ssize_t count = ::send(client.fd, client.output.data(), client.output.size(), MSG_NOSIGNAL);
  if (count < 0 && errno != EAGAIN && errno != EINTR) client.gone = true;
  if (count > 0) client.output.erase(0, static_cast<std::size_t>(count));
}

void TcpLink::flush(Client& client) {
  write_out(client);
  if (client.gone) return;
  const bool done = client.output.empty() && !client.newest_status;
  constexpr std::uint32_t nothing = 0, in = EPOLLIN, out = EPOLLOUT;
  client.io.watch((client.half_closed ? nothing : in) | (done ? nothing : out));
  if (!done || !client.leaving) return;
  if (client.half_closed)
    client.gone = true;
  else
    shutdown(client.fd, SHUT_WR);
}

/// The last words to a client. Closing at once, with input unread, would make the kernel reset the
/// connection and the words be lost: so its input is thrown away until it closes or time is up.
void TcpLink::farewell(Client& client, int code, const std::string& why) {
  client.leaving = true;
  client.caller.subscribed_to_status = false;
  client.input.clear();
  client.farewell_timer = loop_.on_timer(farewell_time, [this, &client] {
    client.gone = true;
    sweep();
  });
  send(client, JsonRpc::to_line(JsonRpc::error(nullptr, code, why)));
}

void TcpLink::publish_status(const JsonRpc::Json& status) {
  std::optional<std::string> line;
  for (const auto& client : clients_) {
    if (!client->caller.subscribed_to_status || client->gone) continue;
    if (!line) line = JsonRpc::to_line(JsonRpc::notification("status", status));
    client->newest_status = line;
    flush(*client);
  }
  sweep();
}

}  // namespace throwcal
