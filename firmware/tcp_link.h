// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <functional>
#include <list>
#include <memory>
#include <string>

#include "firmware/event_loop.h"
#include "firmware/journal.h"
#include "firmware/json_rpc.h"
#include "firmware/listen_socket.h"

namespace throwcal {

struct TcpLinkSettings {
  std::size_t max_line_bytes = 64 * 1024;
  std::size_t max_output_bytes = 1024 * 1024;  ///< waiting for a client that reads slowly
  std::size_t max_clients = 16;
};

/// JSON-RPC over TCP, one object a line, all in the main loop: nothing a client does or fails to do
/// makes anybody wait. `hello` is sent first.
class TcpLink {
 public:
  /// Listens. Throws InputError naming address and cause where it can't.
  TcpLink(EventLoop& loop, const ListenAddress& address, JsonRpc& rpc,
          std::function<JsonRpc::Json()> hello, TcpLinkSettings settings = {});
  ~TcpLink();

  int port() const { return listener_.port(); }
  std::size_t clients() const;
  void forget_tokens();  ///< that clients have shown: there is a new one
  /// Sends a notification to all who subscribed. Who has not read the last one yet gets the newest
  /// when it has: notifications in between are left out, never queued.
  void publish_status(const JsonRpc::Json& status);

 private:
  struct Client;

  void greet(const ListenSocket::Peer& peer);
  void serve(Client& client, std::uint32_t events);
  void read(Client& client);
  void hang_up(Client& client);
  void take_lines(Client& client);
  void send(Client& client, const std::string& line);
  void write_out(Client& client);
  void flush(Client& client);
  void farewell(Client& client, int code, const std::string& why);
  void sweep();

  EventLoop& loop_;
  JsonRpc& rpc_;
  std::function<JsonRpc::Json()> hello_;
  TcpLinkSettings settings_;
  LogOnce once_;
  std::list<std::unique_ptr<Client>> clients_;
  ListenSocket listener_;
};

}  // namespace throwcal
