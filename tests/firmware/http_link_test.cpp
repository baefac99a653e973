// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/http_link.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <fstream>
#include <functional>
#include <set>
#include <thread>

#include "firmware/input_error.h"
#include "tests/support/temporary_folder.h"

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
                      [] { return std::string(); },
                      [](std::int64_t) { return std::nullopt; }};
  Site() {
    rpc.add("status.get", [](const JsonRpc::Json&, JsonRpc::Caller&) -> JsonRpc::Json {
      return {{"number", -1}};
    });
  }
  std::unique_ptr<HttpLink> link(HttpLinkSettings settings = {}) {
    return std::make_unique<HttpLink>(loop, ListenAddress{"127.0.0.1", 0}, rpc, sources, settings);
  }
};

/// Runs the loop until the client's thread is done, its socket closed, and the link as wanted.
template <typename Client>
void run_beside(
    Site& site, int fd, Client client,
    const std::function<bool()>& is_as_wanted = [] { return true; }) {
  std::atomic<bool> done = false;
  std::thread thread([&] {
    client();
    close(fd);
    done = true;
  });
  EventLoop::Source watch;
  watch =
      site.loop.on_timer(1ms, [&] { done&& is_as_wanted() ? site.loop.quit() : watch.after(1ms); });
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
  bool was_cut_off = false;
  const auto client = [&] {  // a byte now and then, so that it is never idle
    say(fd, "GET / HTTP/1.1\r\nHost: box\r\nX-Slow: ");
    char byte = 0;
    while (!was_cut_off) {
      timeval patience{.tv_sec = 0, .tv_usec = 100'000};
      setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
      const bool is_sent = send(fd, "x", 1, MSG_NOSIGNAL) == 1;
      const ssize_t count = recv(fd, &byte, 1, 0);
      was_cut_off = !is_sent || count == 0 || (count < 0 && errno != EAGAIN);
    }
  };
  run_beside(site, fd, client, [&] { return link->connections() == 0; });
  EXPECT_TRUE(was_cut_off);
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

/// Eight cameras that are looked at by eight clients, until so many pictures of each were asked
/// for: in which turns of the loop.
std::vector<std::vector<std::uint64_t>> turns_of_pictures(const std::string& path,
                                                          std::size_t each) {
  constexpr CameraId cameras = 8;
  Site site;
  site.rpc.add("status.get", [](const JsonRpc::Json&, JsonRpc::Caller&) -> JsonRpc::Json {
    const JsonRpc::Json camera{{"name", ""}, {"running", true}, {"error", nullptr}};
    return {{"cameras", std::vector<JsonRpc::Json>(cameras, camera)}};
  });
  site.sources.camera_names.clear();
  for (CameraId i = 0; i < cameras; ++i)
    site.sources.camera_names.push_back("cam" + std::to_string(i));
  std::vector<std::vector<std::uint64_t>> turns(cameras);
  site.sources.preview = [&](CameraId camera) {
    turns.at(camera).push_back(site.loop.turn());
    return std::make_shared<const Preview>(Preview{"JPEG", ""});
  };
  const auto link = site.link();
  std::vector<int> clients;
  for (const std::string& name : site.sources.camera_names) {
    clients.push_back(connected(link->port()));
    say(clients.back(),
        "GET /api/v1/cameras/" + name + "/" + path + " HTTP/1.1\r\nHost: box\r\n\r\n");
  }
  EventLoop::Source watch;
  watch = site.loop.on_timer(1ms, [&] {
    const bool is_done = std::ranges::all_of(turns, [&](auto& one) { return one.size() >= each; });
    is_done ? site.loop.quit() : watch.after(1ms);
  });
  site.loop.run();
  for (const int fd : clients) close(fd);
  return turns;
}

TEST(HttpLink, OnePictureAtMostIsMadeInATurnOfTheLoop) {
  for (const auto& [path, each] : {std::pair("preview.jpg", 1u), std::pair("preview.mjpeg", 4u)}) {
    std::set<std::uint64_t> different;
    std::size_t all = 0;
    for (const auto& turns : turns_of_pictures(path, each)) {
      different.insert(turns.begin(), turns.end());
      all += turns.size();
    }
    EXPECT_EQ(different.size(), all) << path;
  }
}

/// What of a file comes to one who reads on only after all that may take no longer is cut off.
std::size_t read_late(std::uint64_t slowest_bytes_per_s, std::size_t file_bytes) {
  Site site;
  const test::TemporaryFolder folder;
  const std::filesystem::path path = folder.path() / "000001.throwcal";
  std::ofstream(path) << std::string(file_bytes, 'x');
  site.rpc.add("session.get", [](const JsonRpc::Json& params, JsonRpc::Caller&) { return params; });
  site.sources.session_file = [&](std::int64_t) { return path; };
  const auto link = site.link({.request = 0s, .slowest_bytes_per_s = slowest_bytes_per_s});
  const int fd = connected(link->port(), 4096), other = connected(link->port());
  std::size_t got = 0;
  run_beside(site, fd, [&] {
    say(fd, "GET /api/v1/sessions/1/file HTTP/1.1\r\nHost: box\r\n\r\n");
    std::vector<char> block(65536);
    ssize_t count = recv(fd, block.data(), 12, MSG_WAITALL);  // "HTTP/1.1 200"
    EXPECT_EQ(std::string(block.data(), 12), "HTTP/1.1 200");
    say(other, "GET / HTTP/1.1\r\nHost: ");
    EXPECT_LE(recv(other, block.data(), 1, 0), 0) << "cut off";
    while ((count = recv(fd, block.data(), block.size(), 0)) > 0)
      if (got += static_cast<std::size_t>(count); got > file_bytes) break;
  });
  close(other);
  return got;
}

TEST(HttpLink, AFileMayTakeLongerThanAnotherAnswerButNotForEver) {
  constexpr std::size_t bytes = 8'000'000;  // more than the kernel's buffers take
  EXPECT_GT(read_late(1000, bytes), bytes);
  EXPECT_LT(read_late(2 * bytes, bytes), bytes);
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
