// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/http_link.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <thread>

#include "firmware/input_error.h"

namespace throwcal {
namespace {

using namespace std::chrono_literals;

int connected(int port, int receive_buffer_bytes = 0) {
  const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (receive_buffer_bytes > 0)
    setsockopt(fd, SOL_SOCKET, SO_RCVBUF, &receive_buffer_bytes, sizeof receive_buffer_bytes);
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(static_cast<std::uint16_t>(port));
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  EXPECT_EQ(connect(fd, reinterpret_cast<const sockaddr*>(&to), sizeof to), 0);
  return fd;
}

void say(int fd, std::string_view text) { send(fd, text.data(), text.size(), MSG_NOSIGNAL); }

constexpr std::string_view ask_for_events = "GET /api/v1/events HTTP/1.1\r\nHost: box\r\n\r\n";

struct Site {
  EventLoop loop;
  JsonRpc rpc;
  HttpSources sources{{"north"},
                      [](CameraId) { return std::make_shared<const Preview>(); },
                      [] { return std::string(); },
                      [] { return std::string(); }};
  Site() {
    rpc.add("status.get", [](const JsonRpc::Json&, JsonRpc::Caller&) -> JsonRpc::Json {
      return {{"number", -1}};
    });
  }
  std::unique_ptr<HttpLink> link(HttpLinkSettings settings = {}) {
    return std::make_unique<HttpLink>(loop, ListenAddress{"127.0.0.1", 0}, rpc, sources, settings);
  }
};

/// Runs the loop until the client's thread is done; its socket is closed then.
template <typename Client>
void run_beside(Site& site, int fd, Client client) {
  std::atomic<bool> done = false;
  std::thread thread([&] {
    client();
    close(fd);
    done = true;
  });
  EventLoop::Source watch;
  watch = site.loop.on_timer(1ms, [&] { done ? site.loop.quit() : watch.after(1ms); });
  site.loop.run();
  thread.join();
}

TEST(HttpLink, ASlowReaderGetsTheNewestStatusNotAll) {
  Site site;
  const auto link = site.link();
  constexpr int statuses = 1000;
  constexpr std::size_t size_bytes = 20'000;  // 20 MB in all, far more than the kernel's buffers
  const int fd = connected(link->port(), 4096);
  say(fd, ask_for_events);
  int told = 0;
  std::atomic<bool> all_told = false;
  EventLoop::Source teller;
  teller = site.loop.on_timer(1ms, [&] {
    if (link->connections() == 0) return teller.after(1ms);
    link->publish_status({{"number", ++told}, {"ballast", std::string(size_bytes, 'x')}});
    all_told = told == statuses;
    all_told.notify_all();
    if (!all_told) teller.after(100us);
  });
  std::string got;
  run_beside(site, fd, [&] {
    all_told.wait(false);
    const std::string last = "\"number\":" + std::to_string(statuses) + ",";
    char block[65536];
    for (ssize_t count = 1; count > 0 && got.find(last) == got.npos;) {
      count = recv(fd, block, sizeof block, 0);
      if (count > 0) got.append(block, static_cast<std::size_t>(count));
    }
  });
  EXPECT_NE(got.find("\"number\":" + std::to_string(statuses) + ","), got.npos)
      << "the newest came";
  EXPECT_LT(got.size(), statuses * size_bytes / 4) << "not all were kept for it";
}

TEST(HttpLink, ARequestThatNeverEndsIsCutOff) {
  Site site;
  HttpLinkSettings settings;
  settings.request = 1s;
  const auto link = site.link(settings);
  const int fd = connected(link->port());
  std::string got;
  run_beside(site, fd, [&] {  // a byte now and then, so that it is never idle
    say(fd, "GET / HTTP/1.1\r\nHost: box\r\nX-Slow: ");
    char byte = 0;
    while (send(fd, "x", 1, MSG_NOSIGNAL) == 1) {
      timeval patience{.tv_sec = 0, .tv_usec = 100'000};
      setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
      const ssize_t count = recv(fd, &byte, 1, 0);
      if (count == 0 || (count < 0 && errno != EAGAIN)) break;
    }
  });
  EXPECT_EQ(link->connections(), 0u);
}

TEST(HttpLink, AStreamWithoutNewsHasAHeartbeat) {
  Site site;
  HttpLinkSettings settings;
  settings.heartbeat = 0s;
  const auto link = site.link(settings);
  const int fd = connected(link->port());
  say(fd, ask_for_events);
  std::string got;
  run_beside(site, fd, [&] {
    char block[4096];
    while (got.find("\n: heartbeat\n\n") == got.npos) {
      const ssize_t count = recv(fd, block, sizeof block, 0);
      if (count <= 0) break;
      got.append(block, static_cast<std::size_t>(count));
    }
  });
  EXPECT_NE(got.find("event: status\ndata: {\"number\":-1}\n\n"), got.npos) << got;
  EXPECT_NE(got.find("\n: heartbeat\n\n"), got.npos) << got;
}

TEST(HttpLink, ItsEndIsTheEndOfEveryStream) {
  Site site;
  auto link = site.link();
  const int fd = connected(link->port());
  say(fd, ask_for_events);
  std::string got;
  EventLoop::Source end;
  std::atomic<bool> first_is_there = false;
  end = site.loop.on_timer(1ms, [&] {
    if (!first_is_there) return end.after(1ms);
    link.reset();
  });
  run_beside(site, fd, [&] {
    char block[4096];
    for (ssize_t count = 1; count > 0;) {
      count = recv(fd, block, sizeof block, 0);
      if (count > 0) got.append(block, static_cast<std::size_t>(count));
      first_is_there = true;
    }
  });
  EXPECT_TRUE(got.ends_with("\r\n0\r\n\r\n")) << got;  // chunked encoding's own end
}

TEST(HttpLink, APortThatIsTakenIsNamed) {
  Site site;
  const auto link = site.link();
  try {
    HttpLink second(site.loop, {"127.0.0.1", link->port()}, site.rpc, site.sources);
    FAIL() << "two listen at one port";
  } catch (const InputError& error) {
    const std::string place = "127.0.0.1:" + std::to_string(link->port());
    EXPECT_TRUE(std::string(error.what()).starts_with("can't listen at " + place)) << error.what();
  }
}

}  // namespace
}  // namespace throwcal
