// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>

#include "firmware/can_messages.h"
#include "firmware/json_rpc.h"

namespace throwcal {

struct CanOrdersSettings {
  int wrong_keys = 5;             ///< after so many, no key is looked at for...
  std::chrono::seconds lock{10};  ///< ...so long
  std::chrono::seconds remembered_for{
      5};  ///< a command that comes again meanwhile is not done again
};

/// Carries out what command frames ask for: for those who may, and once. Whoever is on a bus can
/// try keys; the lock makes that take longer than a bus lives.
class CanOrders {
 public:
  using Clock = std::chrono::steady_clock;
  /// `send_block`: starts the transfer of a document's block of this number.
  CanOrders(JsonRpc& rpc, std::uint32_t short_key, std::function<CanOutcome(int)> send_block,
            CanOrdersSettings settings = {});

  /// The answer to a command frame of any length.
  CanAck answer(const std::uint8_t* data, std::size_t size, Clock::time_point now);

  /// From now on another one; what was done under the old one is forgotten.
  void set_key(std::uint32_t short_key);

  std::uint64_t commands() const { return commands_; }  ///< that were frames of 8 bytes
  std::uint64_t wrong_keys() const { return wrong_keys_; }

 private:
  struct Done {
    CanPayload command;
    CanOutcome outcome;
    Clock::time_point at;
  };

  CanOutcome carry_out(const CanCommand& command, Clock::time_point now);
  CanOutcome change(const char* method, std::uint32_t key, Clock::time_point now);

  JsonRpc& rpc_;
  std::uint32_t short_key_;
  std::function<CanOutcome(int)> send_block_;
  CanOrdersSettings settings_;
  std::deque<Done> done_;  ///< oldest first
  std::uint64_t commands_ = 0, wrong_keys_ = 0;
  int wrong_in_a_row_ = 0;
  Clock::time_point locked_until_{};
};

}  // namespace throwcal
