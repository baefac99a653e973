// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/listen_socket.h"

#include <gtest/gtest.h>
#include <netinet/in.h>
#include <netinet/tcp.h>

#include "firmware/file_handle.h"

namespace throwcal {
namespace {

using namespace std::chrono_literals;

int option(int fd, int level, int name) {
  int value = -1;
  socklen_t size = sizeof value;
  EXPECT_EQ(getsockopt(fd, level, name, &value, &size), 0);
  return value;
}

FileHandle connected_to(int port) {
  FileHandle out(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  sockaddr_in at{};
  at.sin_family = AF_INET;
  at.sin_port = htons(static_cast<std::uint16_t>(port));
  at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  EXPECT_EQ(connect(out.get(), reinterpret_cast<sockaddr*>(&at), sizeof at), 0);
  return out;
}

TEST(ListenSocket, AClientThatVanishesGivesItsPlaceBackSoon) {
  EventLoop loop;
  FileHandle accepted;
  ListenSocket listener(loop, {"127.0.0.1", 0}, [&](ListenSocket::Peer peer) {
    accepted = FileHandle(peer.fd);
    loop.quit();
  });
  const FileHandle client = connected_to(listener.port());
  loop.run();
  const int fd = accepted.get();
  EXPECT_EQ(option(fd, SOL_SOCKET, SO_KEEPALIVE), 1);
  const int probes_s =
      option(fd, IPPROTO_TCP, TCP_KEEPINTVL) * option(fd, IPPROTO_TCP, TCP_KEEPCNT);
  EXPECT_GT(probes_s, 0);
  EXPECT_LE(option(fd, IPPROTO_TCP, TCP_KEEPIDLE) + probes_s, 90);
  EXPECT_EQ(option(fd, IPPROTO_TCP, TCP_USER_TIMEOUT), 30'000);
}

TEST(ListenSocket, AnAddressThatTheBoxHasNotYetIsToldAndListenedAt) {
  EventLoop loop;
  const bool has_ipv6 = FileHandle(socket(AF_INET6, SOCK_STREAM, 0)).get() >= 0;
  for (const std::string host : {"192.0.2.1", "2001:db8::1"}) {  // RFC 5737, RFC 3849: nobody's
    if (host.find(':') != host.npos && !has_ipv6) continue;
    const ListenSocket listener(loop, {host, 0}, [](ListenSocket::Peer) {});
    EXPECT_GT(listener.port(), 0);
    EXPECT_NE(recent_log_lines().back().find("warning: " + host + ":0 is no address"),
              std::string::npos)
        << recent_log_lines().back();
  }
}

}  // namespace
}  // namespace throwcal
