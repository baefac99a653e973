// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/can_bus.h"

#include <linux/can/error.h>

#include <cerrno>
#include <cstring>

namespace throwcal {

void CanBus::opened() {
  if (was_up_) ++reopened_;
  log_info("CAN: " + interface_ + (was_up_ ? " is back" : " is up"));
  was_up_ = true;
  link_ = CanCondition::up;
  is_passive_ = is_full_ = false;
  problem_.clear();
  for (const auto condition :
       {CanCondition::bus_off, CanCondition::down, CanCondition::missing, CanCondition::unusable})
    once_.forget(to_string(condition));
}

void CanBus::closed(const CanInterface& now) {
  if (now.condition == CanCondition::bus_off && link_ != CanCondition::bus_off) ++bus_off_;
  link_ = now.condition;
  problem_ = now.problem;
  once_.warning(to_string(now.condition), "CAN: " + now.problem + "; waiting for it");
}

bool CanBus::sent(int error) {
  is_full_ = error == ENOBUFS || error == EAGAIN;
  if (error == 0) {
    ++frames_sent_;
    return true;
  }
  ++frames_lost_;
  if (!is_full_) return false;
  ++queue_full_;
  once_.warning("queue", "CAN: " + interface_ +
                             " takes no more frames (its queue is full): is anybody else on the "
                             "bus, at the same bit rate? What can't be sent is left out");
  return true;
}

bool CanBus::heard(const CanSocket::Frame& frame) {
  if (frame.id & CAN_ERR_TX_TIMEOUT) ++tx_timeouts_;
  if (frame.id & CAN_ERR_BUSOFF) return false;
  if (frame.id & CAN_ERR_RESTARTED) is_passive_ = false;
  if (!(frame.id & CAN_ERR_CRTL) || frame.size < 2) return true;
  const bool was_passive = is_passive_;
  is_passive_ = frame.data[1] & (CAN_ERR_CRTL_RX_PASSIVE | CAN_ERR_CRTL_TX_PASSIVE);
  if (!is_passive_ || was_passive) return true;
  ++error_passive_;
  once_.warning("passive", "CAN: " + interface_ +
                               " is error-passive: much on the bus is damaged; look at the cable, "
                               "its two resistors and the bit rate");
  return true;
}

CanCondition CanBus::condition() const {
  if (link_ != CanCondition::up) return link_;
  if (is_full_) return CanCondition::queue_full;
  return is_passive_ ? CanCondition::error_passive : CanCondition::up;
}

nlohmann::ordered_json CanBus::to_json() const {
  using Json = nlohmann::ordered_json;
  return {{"interface", interface_},
          {"state", to_string(condition())},
          {"problem", problem_.empty() ? Json(nullptr) : Json(problem_)},
          {"frames_sent", frames_sent_},
          {"frames_lost", frames_lost_},
          {"queue_full", queue_full_},
          {"bus_off", bus_off_},
          {"error_passive", error_passive_},
          {"tx_timeouts", tx_timeouts_},
          {"reopened", reopened_}};
}

}  // namespace throwcal
