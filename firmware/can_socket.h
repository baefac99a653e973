// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "firmware/can_messages.h"

namespace throwcal {

/// What a bus is good for now.
enum class CanCondition {
  up,
  error_passive,  ///< up, but much of what is sent or received is damaged
  queue_full,     ///< up, but nobody takes what is sent
  bus_off,        ///< the controller has left the bus, or has no carrier
  down,           ///< the interface is not set up
  missing,        ///< there is no such interface
  unusable,       ///< it can't be used as asked for
};
std::string to_string(CanCondition condition);  ///< "up", "error-passive", "queue-full", ...

struct CanInterface {
  int index = 0;
  CanCondition condition = CanCondition::missing;
  std::string problem;  ///< a sentence with what helps; empty where it is up
};
/// Asks the kernel; `fd`: it must carry CAN FD frames.
CanInterface look_at_can(const std::string& name, bool fd);

/// Owns a file descriptor.
class CanDescriptor {
 public:
  explicit CanDescriptor(int number = -1) : number_(number) {}
  CanDescriptor(CanDescriptor&& other) noexcept : number_(other.number_) { other.number_ = -1; }
  CanDescriptor& operator=(CanDescriptor&&) = delete;
  ~CanDescriptor();
  int number() const { return number_; }

 private:
  int number_;
};

/// Frames as they are (CAN_RAW). Never blocks. Throws std::system_error where it can't be opened.
class CanSocket {
 public:
  struct Frame {
    std::uint32_t id = 0;  ///< 11 bits; of an error frame its classes
    bool is_error = false;
    std::array<std::uint8_t, 64> data{};
    std::size_t size = 0;
  };

  /// Takes these identifiers; with `errors` also what the controller says of the bus.
  CanSocket(const CanInterface& interface, const std::vector<std::uint32_t>& ids, bool errors,
            bool fd);
  int fd() const { return socket_.number(); }
  int send(std::uint32_t id, const CanPayload& payload);  ///< 0 or an errno
  int receive(Frame& frame);                              ///< 0 or an errno: EAGAIN, there is none

 private:
  CanDescriptor socket_;
};

/// Long messages (ISO 15765-2, the kernel's can-isotp). Never blocks. Throws std::system_error, of
/// EPROTONOSUPPORT where the kernel has none.
class IsoTpSocket {
 public:
  /// `separation_ms`: asked of whoever sends to us, between two frames.
  IsoTpSocket(const CanInterface& interface, std::uint32_t send_id, std::uint32_t receive_id,
              bool fd, int separation_ms = 0);
  int fd() const { return socket_.number(); }
  int send(std::string_view message);  ///< 0 or an errno: EAGAIN, the last one is not yet through
  int receive(std::string& message);   ///< 0 or an errno: EAGAIN, there is none

 private:
  CanDescriptor socket_;
};

}  // namespace throwcal
