// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/can_orders.h"

#include <algorithm>

namespace throwcal {
namespace {

constexpr std::size_t commands_remembered = 32;

CanOutcome outcome_of(const RpcError& refusal) {
  switch (refusal.code) {
    case rpc_forbidden:
      return CanOutcome::forbidden;
    case rpc_method_not_found:
      return CanOutcome::unknown;
    default:
      return CanOutcome::refused;
  }
}

}  // namespace

CanOrders::CanOrders(JsonRpc& rpc, std::uint32_t short_key,
                     std::function<CanOutcome(int)> send_block, CanOrdersSettings settings)
    : rpc_(rpc), short_key_(short_key), send_block_(std::move(send_block)), settings_(settings) {}

void CanOrders::set_key(std::uint32_t short_key) {
  short_key_ = short_key;
  done_.clear();
}

CanAck CanOrders::answer(const std::uint8_t* data, std::size_t size, Clock::time_point now) {
  CanAck ack;
  CanPayload payload{};
  std::copy_n(data, std::min(size, payload.size()), payload.begin());
  const auto command = decode<CanCommand>(payload);
  ack.order = command.order;
  ack.sequence = command.sequence;
  if (size == payload.size())
    ack.outcome = carry_out(command, now);
  else
    ack.outcome = CanOutcome::malformed;
  JsonRpc::Caller reader;
  const JsonRpc::Json status = rpc_.call("status.get", {}, reader);
  ack.state = can_state_code(status.value("state", ""));
  if (status.contains("session") && status["session"].is_number_integer())
    ack.session = static_cast<std::uint32_t>(status["session"].get<std::int64_t>());
  return ack;
}

/// What was done is not done again: the client, which has missed the answer, gets it again.
CanOutcome CanOrders::carry_out(const CanCommand& command, Clock::time_point now) {
  ++commands_;
  while (!done_.empty() &&
         (now - done_.front().at >= settings_.remembered_for || done_.size() > commands_remembered))
    done_.pop_front();
  const CanPayload payload = encode(command);
  const auto before = std::ranges::find(done_, payload, &Done::command);
  if (before != done_.end()) return before->outcome;
  switch (static_cast<CanOrder>(command.order)) {
    case CanOrder::document:
      return send_block_(command.argument);
    case CanOrder::start:
    case CanOrder::stop:
    case CanOrder::abort: {
      const auto order = static_cast<CanOrder>(command.order);
      const CanOutcome outcome = change(order == CanOrder::start  ? "capture.start"
                                        : order == CanOrder::stop ? "capture.stop"
                                                                  : "capture.abort",
                                        command.key, now);
      if (outcome == CanOutcome::ok) done_.push_back({payload, outcome, now});
      return outcome;
    }
  }
  return CanOutcome::unknown;
}

/// A key of 0 is none: the box's button may have been pressed.
CanOutcome CanOrders::change(const char* method, std::uint32_t key, Clock::time_point now) {
  JsonRpc::Caller caller;
  if (key != 0) {
    if (now < locked_until_) return CanOutcome::locked;
    caller.knows_token = key == short_key_;
    if (!caller.knows_token) {
      ++wrong_keys_;
      if (++wrong_in_a_row_ < settings_.wrong_keys) return CanOutcome::forbidden;
      wrong_in_a_row_ = 0;
      locked_until_ = now + settings_.lock;
      return CanOutcome::locked;
    }
    wrong_in_a_row_ = 0;
  }
  try {
    rpc_.call(method, {}, caller);
    return CanOutcome::ok;
  } catch (const RpcError& refusal) {
    return outcome_of(refusal);
  } catch (const std::exception&) {
    return CanOutcome::refused;
  }
}

}  // namespace throwcal
