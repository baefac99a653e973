// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <nlohmann/json.hpp>
#include <string>

#include "firmware/can_socket.h"
#include "firmware/journal.h"

namespace throwcal {

/// How the bus is, of what the kernel and the controller say; told in the journal once each.
class CanBus {
 public:
  explicit CanBus(std::string interface) : interface_(std::move(interface)) {}

  void opened();
  void closed(const CanInterface& now);
  /// A frame was given to the kernel, which said this (an errno, 0: taken). False: the socket is
  /// good for nothing any more.
  bool sent(int error);
  /// What the controller says. False: it has left the bus.
  bool heard(const CanSocket::Frame& error_frame);

  CanCondition condition() const;
  std::uint64_t frames_lost() const { return frames_lost_; }
  nlohmann::ordered_json to_json() const;

 private:
  std::string interface_;
  CanCondition link_ = CanCondition::missing;  ///< of the interface
  bool is_passive_ = false, is_full_ = false, was_up_ = false;
  std::string problem_ = "not yet opened";
  std::uint64_t frames_sent_ = 0, frames_lost_ = 0, queue_full_ = 0;
  std::uint64_t bus_off_ = 0, error_passive_ = 0, tx_timeouts_ = 0, reopened_ = 0;
  LogOnce once_;
};

}  // namespace throwcal
