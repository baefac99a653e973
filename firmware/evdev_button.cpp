// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/evdev_button.h"

#include <fcntl.h>
#include <libevdev/libevdev.h>
#include <sys/epoll.h>
#include <sys/inotify.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <ctime>

#include "capture/quotation.h"

namespace throwcal {
namespace {

using namespace std::chrono_literals;

constexpr auto look_period = 1s;  // while none is there; a watched folder tells sooner
constexpr auto udev_time = 50ms;  // for a new node to get its owner and its links
constexpr std::size_t max_devices = 16, max_others = 1024;

Button::Time time_of(const input_event& event) {
  return Button::Time(std::chrono::seconds(event.input_event_sec) +
                      std::chrono::microseconds(event.input_event_usec));
}

void say_nothing(const libevdev*, libevdev_log_priority, void*, const char*, int, const char*,
                 const char*, va_list) {}

}  // namespace

struct EvdevButton::Device {
  struct Free {
    void operator()(libevdev* device) const { libevdev_free(device); }
  };

  std::string path, name;
  std::uint64_t inode;  // another one where a device comes back to the same path
  FileHandle file;
  std::unique_ptr<libevdev, Free> keys;
  EventLoop::Source readable;

  std::string contact(unsigned code) const {
    return path + " " + std::to_string(inode) + " " + std::to_string(code);
  }
  std::string shown() const { return in_quotes(name) + " (" + path + ")"; }
};

EvdevButton::EvdevButton(EventLoop& loop, Contacts& contacts, EvdevSettings settings,
                         std::filesystem::path folder)
    : loop_(loop),
      contacts_(contacts),
      settings_(std::move(settings)),
      folder_(std::move(folder)),
      inotify_(inotify_init1(IN_NONBLOCK | IN_CLOEXEC)) {
  if (inotify_.is_open())
    folder_changed_ = loop.on_io(inotify_.get(), EPOLLIN, [this](std::uint32_t) {
      std::array<char, 4096> news;
      while (::read(inotify_.get(), news.data(), news.size()) > 0) continue;
      look_again_.after(udev_time);
    });
  look_again_ = loop.on_timer(look_period, [this] { look(); });
  look();
}

EvdevButton::~EvdevButton() = default;

void EvdevButton::watch_folders() {
  if (!inotify_.is_open()) return;
  constexpr std::uint32_t what = IN_CREATE | IN_ATTRIB | IN_MOVED_TO;
  for (const char* below : {"", "by-path", "by-id"})
    inotify_add_watch(inotify_.get(), (folder_ / below).c_str(), what);
}

void EvdevButton::look() {
  watch_folders();
  if (!settings_.device.empty()) {
    take_up(settings_.device);
  } else {
    std::error_code error;
    for (const auto& entry : std::filesystem::directory_iterator(folder_, error))
      if (entry.path().filename().string().starts_with("event")) take_up(entry.path());
  }
  if (!devices_.empty()) return;
  once_.warning("none", "button: no input device " +
                            (settings_.device.empty() ? "here" : settings_.device.string()) +
                            " with the key " + name_of_key(settings_.keys.front()) +
                            (settings_.keys.size() > 1 ? " or another" : "") +
                            "; it is waited for");
  look_again_.after(look_period);
}

void EvdevButton::take_up(const std::filesystem::path& path) {
  struct stat facts {};
  if (stat(path.c_str(), &facts) != 0 || !S_ISCHR(facts.st_mode)) return;
  const Node node(facts.st_rdev, facts.st_ino);
  if (devices_.contains(node) || others_.contains(node) || devices_.size() >= max_devices) return;
  auto device = std::make_unique<Device>();
  device->path = path.string();
  device->inode = facts.st_ino;
  device->file = FileHandle(::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC));
  if (!device->file.is_open()) {
    if (!settings_.device.empty() || errno == EACCES)
      once_.warning("open " + device->path, "button: " + device->path + ": " + strerror(errno));
    return;
  }
  libevdev* keys = nullptr;
  const bool is_one = libevdev_new_from_fd(device->file.get(), &keys) == 0;
  device->keys.reset(keys);
  const auto has = [&](unsigned code) {
    return is_one && libevdev_has_event_code(keys, EV_KEY, code) == 1;
  };
  if (std::ranges::none_of(settings_.keys, has)) {
    if (others_.size() >= max_others) others_.clear();
    others_.insert(node);
    return;
  }
  libevdev_set_device_log_function(keys, say_nothing, LIBEVDEV_LOG_ERROR, nullptr);
  device->name = libevdev_get_name(keys);
  if (libevdev_set_clock_id(keys, CLOCK_MONOTONIC) != 0 || !grab(*device)) {
    once_.warning("open " + device->path,
                  "button: " + device->shown() + ": another program has it for itself");
    return;
  }
  for (const unsigned code : settings_.keys)
    if (has(code))
      contacts_.add(device->contact(code), libevdev_get_event_value(keys, EV_KEY, code) != 0);
  device->readable = loop_.on_io(device->file.get(), EPOLLIN, [this, node](std::uint32_t) {
    if (!read(*devices_.at(node))) drop(node);
  });
  log_info("button: " + device->shown());
  once_.forget("none");
  once_.forget("open " + device->path);
  devices_.emplace(node, std::move(device));
}

bool EvdevButton::grab(Device& device) const {
  return !settings_.grab || libevdev_grab(device.keys.get(), LIBEVDEV_GRAB) == 0;
}

/// False: the device is gone.
bool EvdevButton::read(Device& device) {
  input_event event{};
  unsigned flag = LIBEVDEV_READ_FLAG_NORMAL;
  while (true) {
    const int status = libevdev_next_event(device.keys.get(), flag, &event);
    if (status == -EAGAIN && flag == LIBEVDEV_READ_FLAG_NORMAL) return true;
    if (status < 0 && status != -EAGAIN) return status == -EINTR;
    // The kernel dropped events: what they changed comes as events, then the stream goes on.
    flag =
        status == LIBEVDEV_READ_STATUS_SYNC ? LIBEVDEV_READ_FLAG_SYNC : LIBEVDEV_READ_FLAG_NORMAL;
    constexpr int autorepeat = 2;
    if (status < 0 || event.type != EV_KEY || event.value == autorepeat) continue;
    if (std::ranges::find(settings_.keys, event.code) != settings_.keys.end())
      contacts_.edge(device.contact(event.code), event.value != 0, time_of(event));
  }
}

void EvdevButton::drop(Node node) {
  const auto gone = devices_.extract(node);
  for (const unsigned code : settings_.keys) contacts_.remove(gone.mapped()->contact(code));
  log_warning("button: " + gone.mapped()->shown() + " was unplugged");
  look_again_.after(udev_time);
}

void EvdevButton::read_edges() {
  for (auto device = devices_.begin(); device != devices_.end();) {
    const auto here = device++;
    if (!read(*here->second)) drop(here->first);
  }
}

}  // namespace throwcal
