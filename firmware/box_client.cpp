// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/box_client.h"

#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

namespace throwcal {
namespace {

using namespace std::chrono_literals;
constexpr auto connect_timeout = 5s, answer_timeout = 20s;

bool wait_for(int fd, short events, std::chrono::milliseconds timeout) {
  const auto deadline = std::chrono::steady_clock::now() + timeout;
  for (;;) {
    const auto left =
        std::chrono::ceil<std::chrono::milliseconds>(deadline - std::chrono::steady_clock::now());
    pollfd waiting{.fd = fd, .events = events, .revents = 0};
    const int ready = poll(&waiting, 1, static_cast<int>(std::max(left, 0ms).count()));
    if (ready > 0) return true;
    if (ready == 0 || errno != EINTR) return false;
  }
}

/// A connected socket, or -1 with errno set.
int connect_to(const addrinfo& to) {
  const int fd = socket(to.ai_family, to.ai_socktype | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (fd < 0) return -1;
  int error = connect(fd, to.ai_addr, to.ai_addrlen) == 0 ? 0 : errno;
  if (error == EINPROGRESS) {
    socklen_t size = sizeof error;
    if (!wait_for(fd, POLLOUT, connect_timeout))
      error = ETIMEDOUT;
    else
      getsockopt(fd, SOL_SOCKET, SO_ERROR, &error, &size);
  }
  if (error == 0) return fd;
  close(fd);
  errno = error;
  return -1;
}

int open_connection(const ListenAddress& address, const std::string& place) {
  addrinfo hints{}, *found = nullptr;
  hints.ai_socktype = SOCK_STREAM;
  if (const int error =
          getaddrinfo(address.host.c_str(), std::to_string(address.port).c_str(), &hints, &found);
      error != 0)
    throw BoxError("no box answers at " + place + " (" + gai_strerror(error) + ")");
  const std::unique_ptr<addrinfo, void (*)(addrinfo*)> owner(found, freeaddrinfo);
  for (const addrinfo* each = found; each; each = each->ai_next)
    if (const int fd = connect_to(*each); fd >= 0) return fd;
  throw BoxError("no box answers at " + place + " (" + std::strerror(errno) +
                 "); is throwcald running?");
}

}  // namespace

BoxClient::BoxClient(const ListenAddress& address)
    : place_(address.host + ":" + std::to_string(address.port)),
      fd_(open_connection(address, place_)) {
  try {
    const auto first = message(answer_timeout);
    if (!first) throw BoxError(place_ + " says nothing; is it a throwcald?");
    if (first->contains("error")) throw BoxError(first->at("error").at("message"));
    hello_ = first->at("params");
  } catch (const Json::exception&) {
    close(fd_);
    throw BoxError("what answers at " + place_ + " is not a throwcald");
  } catch (...) {
    close(fd_);
    throw;
  }
}

BoxClient::~BoxClient() { close(fd_); }

std::optional<BoxClient::Json> BoxClient::message(std::chrono::milliseconds timeout) {
  const auto deadline = std::chrono::steady_clock::now() + timeout;
  for (;;) {
    if (const auto end = input_.find('\n'); end != input_.npos) {
      Json out = Json::parse(input_.substr(0, end));
      input_.erase(0, end + 1);
      return out;
    }
    const auto left =
        std::chrono::ceil<std::chrono::milliseconds>(deadline - std::chrono::steady_clock::now());
    if (!wait_for(fd_, POLLIN, left)) return {};
    char block[1 << 16];
    const ssize_t count = recv(fd_, block, sizeof block, 0);
    if (count < 0 && (errno == EINTR || errno == EAGAIN)) continue;
    if (count <= 0) throw BoxError("the box at " + place_ + " closed the connection");
    input_.append(block, static_cast<std::size_t>(count));
  }
}

BoxClient::Json BoxClient::call(const std::string& method, const Json& params) {
  const std::int64_t id = ++last_id_;
  std::string line =
      Json{{"jsonrpc", "2.0"}, {"id", id}, {"method", method}, {"params", params}}.dump() + "\n";
  std::string_view rest = line;
  while (!rest.empty()) {
    const ssize_t count = send(fd_, rest.data(), rest.size(), MSG_NOSIGNAL);
    if (count < 0 && errno == EAGAIN && wait_for(fd_, POLLOUT, answer_timeout)) continue;
    if (count < 0 && errno != EINTR)
      throw BoxError("the box at " + place_ + " closed the connection");
    rest.remove_prefix(static_cast<std::size_t>(std::max<ssize_t>(count, 0)));
  }
  while (const auto answer = message(answer_timeout)) {
    if (!answer->contains("id") || answer->at("id") != id) continue;
    if (answer->contains("error")) throw BoxError(answer->at("error").at("message"));
    return answer->at("result");
  }
  throw BoxError("the box at " + place_ + " did not answer " + method + " in time");
}

std::optional<BoxClient::Json> BoxClient::notification(std::chrono::milliseconds timeout) {
  const auto deadline = std::chrono::steady_clock::now() + timeout;
  while (const auto given = message(std::chrono::ceil<std::chrono::milliseconds>(
             deadline - std::chrono::steady_clock::now())))
    if (given->contains("method") && given->contains("params")) return given->at("params");
  return {};
}

}  // namespace throwcal
