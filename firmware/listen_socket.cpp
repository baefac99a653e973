// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/listen_socket.h"

#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/epoll.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <memory>

#include "firmware/input_error.h"

namespace throwcal {
namespace {

/// A client that has vanished (power off, cable out) gives its place back within 90 s: one that is
/// silent by the probes, one that something is being sent to by what it does not acknowledge.
constexpr int keepalive_idle_s = 60, keepalive_interval_s = 10, keepalive_probes = 3;
constexpr int unacknowledged_ms = 30'000;

void set_option(int fd, int level, int option, int value) {
  setsockopt(fd, level, option, &value, sizeof value);
}

bool bind_to(int fd, const addrinfo& at) { return bind(fd, at.ai_addr, at.ai_addrlen) == 0; }

int listen_at(const addrinfo& at, const std::string& place) {
  const int fd = socket(at.ai_family, at.ai_socktype | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (fd < 0) return -1;
  set_option(fd, SOL_SOCKET, SO_REUSEADDR, 1);
  bool is_bound = bind_to(fd, at);
  if (!is_bound && errno == EADDRNOTAVAIL) {  // the network may come later
    at.ai_family == AF_INET6 ? set_option(fd, IPPROTO_IPV6, IPV6_FREEBIND, 1)
                             : set_option(fd, IPPROTO_IP, IP_FREEBIND, 1);
    is_bound = bind_to(fd, at);
    if (is_bound)
      log_warning(place + " is no address of this box now; it listens there once it is one");
  }
  if (is_bound && listen(fd, SOMAXCONN) == 0) return fd;
  const int error = errno;
  close(fd);
  errno = error;
  return -1;
}

int open_listener(const ListenAddress& address) {
  const std::string place = address.host + ":" + std::to_string(address.port);
  addrinfo hints{}, *found = nullptr;
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = AI_PASSIVE;
  if (const int error =
          getaddrinfo(address.host.c_str(), std::to_string(address.port).c_str(), &hints, &found);
      error != 0)
    throw InputError("can't listen at " + place + ": " + gai_strerror(error));
  const std::unique_ptr<addrinfo, void (*)(addrinfo*)> owner(found, freeaddrinfo);
  if (const int fd = listen_at(*found, place); fd >= 0) return fd;
  throw InputError("can't listen at " + place + ": " + std::strerror(errno) +
                   (errno == EADDRINUSE ? "; is another throwcald running?" : ""));
}

}  // namespace

ListenSocket::ListenSocket(EventLoop& loop, const ListenAddress& address,
                           std::function<void(Peer)> accept)
    : accept_(std::move(accept)),
      fd_(open_listener(address)),
      source_(loop.on_io(fd_, EPOLLIN, [this](std::uint32_t) { accept_all(); })) {}

ListenSocket::~ListenSocket() {
  source_ = {};
  close(fd_);
}

int ListenSocket::port() const {
  sockaddr_storage at{};
  socklen_t size = sizeof at;
  getsockname(fd_, reinterpret_cast<sockaddr*>(&at), &size);
  return ntohs(at.ss_family == AF_INET6 ? reinterpret_cast<sockaddr_in6&>(at).sin6_port
                                        : reinterpret_cast<sockaddr_in&>(at).sin_port);
}

void ListenSocket::accept_all() {
  for (;;) {
    Peer peer;
    peer.address_size = sizeof peer.address;
    peer.fd = accept4(fd_, reinterpret_cast<sockaddr*>(&peer.address), &peer.address_size,
                      SOCK_CLOEXEC | SOCK_NONBLOCK);
    if (peer.fd < 0 && errno == EINTR) continue;
    if (peer.fd < 0 && errno != EAGAIN)
      once_.warning("accept", std::string("a client can't be accepted: ") + std::strerror(errno));
    if (peer.fd < 0) return;
    set_option(peer.fd, IPPROTO_TCP, TCP_NODELAY, 1);
    set_option(peer.fd, SOL_SOCKET, SO_KEEPALIVE, 1);
    set_option(peer.fd, IPPROTO_TCP, TCP_KEEPIDLE, keepalive_idle_s);
    set_option(peer.fd, IPPROTO_TCP, TCP_KEEPINTVL, keepalive_interval_s);
    set_option(peer.fd, IPPROTO_TCP, TCP_KEEPCNT, keepalive_probes);
    set_option(peer.fd, IPPROTO_TCP, TCP_USER_TIMEOUT, unacknowledged_ms);
    accept_(peer);
  }
}

}  // namespace throwcal
