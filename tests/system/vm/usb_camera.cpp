// SPDX-License-Identifier: BSD-3-Clause
// USB cameras that exist only for the kernel, which believes in them and lets its uvcvideo drive
// them: it asks over USB/IP, through its virtual host controller (module vhci-hcd).
//
//   usb_camera MANUFACTURER,MODEL,SERIAL...
//
// plugs camera 0, 1, ... (without a serial number where SERIAL is empty) into port 0, 1, ...
// Standard input takes a command a line, and its end unplugs all:
//
//   plug N [PORT]    into the port of last time, or that; all controls have their defaults then
//   unplug N
//
// Standard output tells what was done: "plugged N PORT", "unplugged N". What the cameras show and
// can: uvc_camera.h.
#include <arpa/inet.h>
#include <linux/usbip.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <deque>
#include <fstream>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "tests/system/vm/uvc_camera.h"

namespace {

using usb::Bytes, usb::Clock;

// ---- USB/IP: a message is 48 bytes of big-endian numbers, then data.

constexpr std::uint32_t cmd_submit = 1, cmd_unlink = 2, ret_submit = 3, ret_unlink = 4;

struct Message {
  std::uint32_t command, number, device, is_in, endpoint;
  std::uint32_t flags, length, start_frame, packets, interval;  ///< of cmd_submit
  usb_ctrlrequest asked;                                        ///< is little-endian
};
static_assert(sizeof(Message) == 48);

const std::string controller = "/sys/devices/platform/vhci_hcd.0/";

void tell_controller(const std::string& file, const std::string& text) {
  std::ofstream out(controller + file);
  if (!(out << text << std::flush))
    throw std::system_error(errno, std::generic_category(), controller + file + ", " + text);
}

bool is_free(int port) {
  std::ifstream status(controller + "status");
  std::string hub;
  int number = 0, state = 0;
  for (std::string line; std::getline(status, line);)
    if (std::istringstream(line) >> hub >> number >> state && number == port)
      return state == VDEV_ST_NULL;
  throw std::runtime_error("the controller has no port " + std::to_string(port));
}

/// A camera, its port, and the connection there.
class Camera {
 public:
  Camera(int number, usb::Identity identity)
      : number_(number), port_(number), camera_(std::move(identity)) {}

  int fd() const { return fd_; }
  /// A port may still be in use by a camera just unplugged: `go_on` plugs when it is free.
  void plug(int port) {
    unplug();
    port_ = port, is_wanted_ = true;
  }
  void plug() { plug(port_); }
  void unplug() {
    is_wanted_ = false;
    if (fd_ < 0) return;
    tell_controller("detach", std::to_string(port_));
    leave();
  }
  std::optional<Clock::time_point> due() const {
    if (is_wanted_) return Clock::now() + std::chrono::milliseconds(5);
    return camera_.due();
  }
  /// What time and earlier requests bring.
  void go_on() {
    if (is_wanted_ && is_free(port_)) attach();
    if (const auto due = camera_.due(); due && *due <= Clock::now()) camera_.expose();
    while (camera_.has_data() && !waiting_.empty()) {
      const Message request = waiting_.front();
      waiting_.pop_front();
      reply(request, camera_.payload(request.length));
    }
  }
  void receive() {
    Message message{};
    if (!read_whole(&message, sizeof message)) return leave();
    for (std::uint32_t* word = &message.command; word <= &message.interval; ++word)
      *word = ntohl(*word);
    if (message.command == cmd_unlink) return unlink(message);
    Bytes data(message.is_in ? 0 : message.length);
    if (!read_whole(data.data(), data.size())) return leave();
    if (message.endpoint == usb::bulk_endpoint)
      waiting_.push_back(message);
    else
      reply(message, camera_.answer(message.asked, data));
  }

 private:
  void attach() {
    int ends[2];
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) < 0)
      throw std::system_error(errno, std::generic_category());
    fd_ = ends[0];
    tell_controller("attach", std::to_string(port_) + ' ' + std::to_string(ends[1]) + ' ' +
                                  std::to_string(number_ + 1) + ' ' +
                                  std::to_string(USB_SPEED_HIGH));
    close(ends[1]);
    is_wanted_ = false;
    std::printf("plugged %d %d\n", number_, port_);
  }
  void leave() {
    close(std::exchange(fd_, -1));
    camera_.lose_power();
    waiting_.clear();
    std::printf("unplugged %d\n", number_);
  }
  bool read_whole(void* out, std::size_t size) {
    return size == 0 || recv(fd_, out, size, MSG_WAITALL) == static_cast<ssize_t>(size);
  }
  /// The kernel reads always. A connection that it closed is noticed when it is read.
  void send_whole(const Bytes& data) {
    for (std::size_t sent = 0; sent < data.size();) {
      const ssize_t n = send(fd_, &data[sent], data.size() - sent, MSG_NOSIGNAL);
      if (n <= 0) return;
      sent += static_cast<std::size_t>(n);
    }
  }
  void send_reply(std::uint32_t command, std::uint32_t number, int status, const Bytes& data,
                  std::uint32_t length) {
    std::array<std::uint32_t, 12> head{command, number, 0, 0, 0, static_cast<std::uint32_t>(status),
                                       length};
    for (std::uint32_t& word : head) word = htonl(word);
    send_whole(usb::bytes(usb::bytes_of(head), data));
  }
  void reply(const Message& request, usb::Answer given) {
    if (!given) return send_reply(ret_submit, request.number, -EPIPE, {}, 0);
    if (!request.is_in) return send_reply(ret_submit, request.number, 0, {}, request.length);
    given->resize(std::min<std::size_t>(given->size(), request.length));
    send_reply(ret_submit, request.number, 0, *given, static_cast<std::uint32_t>(given->size()));
  }
  void unlink(const Message& message) {
    const auto victim = message.flags;
    const auto erased =
        std::erase_if(waiting_, [&](const Message& m) { return m.number == victim; });
    send_reply(ret_unlink, message.number, erased ? -ECONNRESET : 0, {}, 0);
  }

  int number_, port_, fd_ = -1;
  bool is_wanted_ = false;
  usb::UvcCamera camera_;
  std::deque<Message> waiting_;  ///< for a frame
};

// ---- Commands

void obey(std::deque<Camera>& cameras, const std::string& line) {
  std::istringstream words(line);
  std::string verb;
  std::size_t number = 0;
  if (!(words >> verb >> number) || number >= cameras.size() ||
      (verb != "plug" && verb != "unplug"))
    throw std::runtime_error("\"" + line + "\": expected plug N [PORT], or unplug N");
  int port = 0;
  if (verb == "unplug")
    cameras[number].unplug();
  else if (words >> port)
    cameras[number].plug(port);
  else
    cameras[number].plug();
}

/// False at the end of standard input. A line comes whole: who writes it writes it at once.
bool read_commands(std::deque<Camera>& cameras) {
  char text[4096];
  const ssize_t n = read(STDIN_FILENO, text, sizeof text);
  if (n <= 0) return false;
  std::istringstream lines(std::string(text, static_cast<std::size_t>(n)));
  for (std::string line; std::getline(lines, line);) obey(cameras, line);
  return true;
}

/// Until something comes or is due. What it returns belongs to standard input, then the cameras.
std::vector<pollfd> wait(const std::deque<Camera>& cameras) {
  std::vector<pollfd> files{{STDIN_FILENO, POLLIN, 0}};
  auto until = Clock::time_point::max();
  for (const Camera& camera : cameras) {
    files.push_back({camera.fd(), POLLIN, 0});
    until = std::min(until, camera.due().value_or(until));
  }
  const auto left = std::max<std::int64_t>((until - Clock::now()) / std::chrono::nanoseconds(1), 0);
  const timespec patience{left / 1'000'000'000, left % 1'000'000'000};
  ppoll(files.data(), files.size(), until == Clock::time_point::max() ? nullptr : &patience,
        nullptr);
  return files;
}

void run(std::deque<Camera>& cameras) {
  for (Camera& camera : cameras) camera.plug();
  while (true) {
    for (Camera& camera : cameras) camera.go_on();
    const std::vector<pollfd> files = wait(cameras);
    for (std::size_t i = 0; i < cameras.size(); ++i)
      if (files[i + 1].revents) cameras[i].receive();
    if (files[0].revents && !read_commands(cameras)) return;
  }
}

usb::Identity identity_of(const std::string& argument) {
  std::istringstream words(argument);
  usb::Identity out;
  for (std::string& word : out) std::getline(words, word, ',');
  return out;
}

}  // namespace

int main(int argc, char** argv) {
  setvbuf(stdout, nullptr, _IOLBF, 0);
  std::deque<Camera> cameras;
  for (int i = 1; i < argc; ++i) cameras.emplace_back(i - 1, identity_of(argv[i]));
  try {
    run(cameras);
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "usb_camera: %s\n", error.what());
    return 1;
  }
}
