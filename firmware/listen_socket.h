// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <sys/socket.h>

#include <functional>
#include <string>

#include "firmware/event_loop.h"
#include "firmware/journal.h"
#include "firmware/listen_address.h"

namespace throwcal {

/// A TCP socket that listens, in the main loop: whoever connects is handed over, non-blocking.
class ListenSocket {
 public:
  struct Peer {
    int fd = -1;  ///< the receiver's to close
    sockaddr_storage address{};
    socklen_t address_size = 0;
  };

  /// Throws InputError naming address and cause where it can't listen. An address that the box has
  /// not yet is told as a warning, and is listened at as soon as it has it.
  ListenSocket(EventLoop& loop, const ListenAddress& address, std::function<void(Peer)> accept);
  ~ListenSocket();
  ListenSocket(const ListenSocket&) = delete;
  ListenSocket& operator=(const ListenSocket&) = delete;

  int port() const;  ///< the number it got, where 0 was asked for

 private:
  void accept_all();

  const std::function<void(Peer)> accept_;
  const int fd_;
  LogOnce once_;
  EventLoop::Source source_;
};

}  // namespace throwcal
