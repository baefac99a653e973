// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>

#include "firmware/contacts.h"
#include "firmware/event_loop.h"
#include "firmware/file_handle.h"
#include "firmware/journal.h"
#include "firmware/panel_settings.h"

struct libevdev;

namespace throwcal {

/// Keys of input devices as contacts: of those that are there, and of those that come.
class EvdevButton {
 public:
  /// Borrows both for its life. A device that is missing is waited for.
  EvdevButton(EventLoop& loop, Contacts& contacts, EvdevSettings settings,
              std::filesystem::path folder = "/dev/input");
  ~EvdevButton();

  void read_edges();  ///< that wait already

 private:
  struct Device;
  /// Which device a path leads to: a node made anew is another one.
  using Node = std::pair<std::uint64_t, std::uint64_t>;

  void look();
  void watch_folders();
  void take_up(const std::filesystem::path& path);
  bool grab(Device& device) const;
  bool read(Device& device);
  void drop(Node node);

  EventLoop& loop_;
  Contacts& contacts_;
  EvdevSettings settings_;
  std::filesystem::path folder_;
  FileHandle inotify_;
  LogOnce once_;
  std::map<Node, std::unique_ptr<Device>> devices_;
  std::set<Node> others_;  ///< that have no such key
  EventLoop::Source folder_changed_, look_again_;
};

}  // namespace throwcal
