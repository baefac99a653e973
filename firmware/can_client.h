// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <chrono>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "firmware/can_document.h"
#include "firmware/can_report.h"
#include "firmware/can_socket.h"

namespace throwcal {

struct CanClientSettings {
  std::string interface = "can0";
  int unit = 0;
  std::chrono::milliseconds patience = std::chrono::seconds(5);  ///< for whatever is waited for
};

/// A box on a CAN bus, seen from another place on it. Blocks. Throws BoxError: no interface, no box
/// heard, or it says no.
class CanClient {
 public:
  /// Listens until the box's heartbeat has come.
  explicit CanClient(CanClientSettings settings);

  /// What the box tells by itself, once all of it has come: the keys of the status document, and
  /// the poses of the first eight cameras.
  nlohmann::ordered_json status();
  /// The latest calibration: the text that calibration.latest has on TCP.
  std::string document();
  /// Returns when the box has done it.
  CanAck order(CanOrder order, std::uint32_t key);

 private:
  using Clock = std::chrono::steady_clock;

  bool wait(int fd, Clock::time_point until) const;
  bool hear(Clock::time_point until);
  void take(int offset, const CanPayload& payload);
  void listen_for(const char* what, const std::function<bool()>& is_there);
  CanAck ask(CanOrder order, int argument, std::uint32_t key);
  std::optional<std::string> block(IsoTpSocket& isotp);
  [[noreturn]] void is_silent(const std::string& what) const;

  CanClientSettings settings_;
  CanInterface interface_;
  CanSocket socket_;
  CanReport report_;
  std::uint64_t heard_ = 0;  ///< a bit an offset that has come
  std::optional<CanAck> ack_;
  int sequence_;  ///< of the next command
};

}  // namespace throwcal
