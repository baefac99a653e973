// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <chrono>
#include <nlohmann/json.hpp>
#include <optional>

#include "firmware/can_bus.h"
#include "firmware/can_document.h"
#include "firmware/can_orders.h"
#include "firmware/can_report.h"
#include "firmware/can_settings.h"
#include "firmware/can_socket.h"
#include "firmware/event_loop.h"
#include "firmware/json_rpc.h"

namespace throwcal {

/// The box on a CAN bus, all in the main loop: tells its report, takes commands, sends documents.
/// An interface that is missing, goes away or leaves the bus is waited for; what can't be sent is
/// counted and left out, for the next report is newer.
class CanLink {
 public:
  /// Never throws because of the bus. `short_key`: Access::short_key().
  CanLink(EventLoop& loop, const CanSettings& settings, JsonRpc& rpc, std::uint32_t short_key);
  ~CanLink();

  nlohmann::ordered_json status() const;
  void set_key(std::uint32_t short_key) { orders_.set_key(short_key); }

 private:
  using Clock = std::chrono::steady_clock;

  void tick();
  void look_after_interface();
  void open(const CanInterface& interface);
  void open_isotp();
  void close(const CanInterface& now);
  void give_up(int error);
  void renew_report();
  bool has_other_result(const nlohmann::ordered_json& status);
  void renew_result();
  void set_result(std::string text);
  void tell_report();
  bool send(int offset, const CanPayload& payload);
  void read();
  void read_isotp();
  void obey(const CanSocket::Frame& frame);
  CanOutcome send_block(int number);
  std::uint32_t id(int offset) const;

  EventLoop& loop_;
  const CanSettings settings_;
  JsonRpc& rpc_;
  CanBus bus_;
  CanOrders orders_;
  CanInterface interface_;
  std::optional<CanSocket> socket_;
  std::optional<IsoTpSocket> isotp_;
  EventLoop::Source timer_, io_, isotp_io_;

  CanReport report_;
  CanDocument newest_, sending_;      ///< the newest result, and the one whose blocks are asked for
  nlohmann::ordered_json result_of_;  ///< what the status said when it was asked for
  int last_sequence_ = 0;
  std::uint64_t tenth_ = 0, next_look_ = 0, result_renewed_at_ = 0;
  int commands_left_ = 0;  ///< that are taken until the next tick
  std::uint64_t commands_ignored_ = 0, blocks_sent_ = 0, transfers_failed_ = 0;
  std::string isotp_problem_;
  Clock::time_point next_tick_ = Clock::now();
  LogOnce once_;
};

}  // namespace throwcal
