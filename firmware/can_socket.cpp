// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/can_socket.h"

#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/isotp.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <net/if_arp.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <system_error>

namespace throwcal {
namespace {

int opened(int type, int protocol) {
  const int fd = socket(PF_CAN, type | SOCK_CLOEXEC | SOCK_NONBLOCK, protocol);
  if (fd < 0) throw std::system_error(errno, std::generic_category(), "no CAN socket");
  return fd;
}

void bind_to(int fd, const sockaddr_can& address) {
  if (bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0)
    throw std::system_error(errno, std::generic_category(), "a CAN socket can't be bound");
}

template <typename Value>
void set(int fd, int level, int option, const Value& value, std::size_t size = sizeof(Value)) {
  if (setsockopt(fd, level, option, &value, static_cast<socklen_t>(size)) != 0)
    throw std::system_error(errno, std::generic_category(), "a CAN socket's option");
}

sockaddr_can address_of(const CanInterface& interface) {
  sockaddr_can out{};
  out.can_family = AF_CAN;
  out.can_ifindex = interface.index;
  return out;
}

CanInterface unusable(int index, std::string problem) {
  return {index, CanCondition::unusable, std::move(problem)};
}

}  // namespace

std::string to_string(CanCondition condition) {
  constexpr std::array<const char*, 7> words{"up",   "error-passive", "queue-full", "bus-off",
                                             "down", "missing",       "unusable"};
  return words[static_cast<std::size_t>(condition)];
}

CanInterface look_at_can(const std::string& name, bool fd) {
  const CanDescriptor any(socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  ifreq request{};
  name.copy(request.ifr_name, sizeof request.ifr_name - 1);
  const auto asked = [&](unsigned long what) { return ioctl(any.number(), what, &request) == 0; };
  if (!asked(SIOCGIFINDEX))
    return {0, CanCondition::missing, "there is no interface " + name + " (ip link lists them)"};
  const int index = request.ifr_ifindex;
  if (!asked(SIOCGIFHWADDR) || request.ifr_hwaddr.sa_family != ARPHRD_CAN)
    return unusable(index, name + " is no CAN interface");
  if (!asked(SIOCGIFMTU) || (fd && request.ifr_mtu < static_cast<int>(CANFD_MTU)))
    return unusable(index, name + " carries no CAN FD frames: ip link set " + name +
                               " type can fd on, or leave out fd");
  if (!asked(SIOCGIFFLAGS) || !(request.ifr_flags & IFF_UP))
    return {index, CanCondition::down,
            name + " is down: ip link set " + name + " up type can bitrate 500000"};
  if (!(request.ifr_flags & IFF_RUNNING))
    return {index, CanCondition::bus_off,
            name +
                " is off the bus (bus-off, or no carrier): look at the cable, its two resistors "
                "and the bit rate; ip link set " +
                name + " type can restart-ms 100 lets it come back by itself"};
  return {index, CanCondition::up, ""};
}

CanDescriptor::~CanDescriptor() {
  if (number_ >= 0) close(number_);
}

CanSocket::CanSocket(const CanInterface& interface, const std::vector<std::uint32_t>& ids,
                     bool errors, bool fd)
    : socket_(opened(SOCK_RAW, CAN_RAW)) {
  std::vector<can_filter> filters;
  for (const std::uint32_t id : ids)
    filters.push_back({id, CAN_SFF_MASK | CAN_EFF_FLAG | CAN_RTR_FLAG});
  set(socket_.number(), SOL_CAN_RAW, CAN_RAW_FILTER, *filters.data(),
      filters.size() * sizeof(can_filter));
  // Not each damaged frame: a bad cable makes thousands a second.
  const can_err_mask_t classes =
      errors ? CAN_ERR_BUSOFF | CAN_ERR_RESTARTED | CAN_ERR_CRTL | CAN_ERR_TX_TIMEOUT : 0;
  set(socket_.number(), SOL_CAN_RAW, CAN_RAW_ERR_FILTER, classes);
  set(socket_.number(), SOL_CAN_RAW, CAN_RAW_FD_FRAMES, int{fd});
  bind_to(socket_.number(), address_of(interface));
}

int CanSocket::send(std::uint32_t id, const CanPayload& payload) {
  can_frame frame{};
  frame.can_id = id;
  frame.can_dlc = static_cast<std::uint8_t>(payload.size());
  std::ranges::copy(payload, frame.data);
  return write(socket_.number(), &frame, sizeof frame) == sizeof frame ? 0 : errno;
}

int CanSocket::receive(Frame& frame) {
  canfd_frame raw{};
  const ssize_t count = read(socket_.number(), &raw, sizeof raw);
  if (count < 0) return errno;
  if (count != CAN_MTU && count != CANFD_MTU) return EAGAIN;
  frame.is_error = raw.can_id & CAN_ERR_FLAG;
  frame.id = raw.can_id & (frame.is_error ? CAN_ERR_MASK : CAN_SFF_MASK);
  frame.size = std::min<std::size_t>(raw.len, frame.data.size());
  std::copy_n(raw.data, frame.size, frame.data.begin());
  return 0;
}

IsoTpSocket::IsoTpSocket(const CanInterface& interface, std::uint32_t send_id,
                         std::uint32_t receive_id, bool fd, int separation_ms)
    : socket_(opened(SOCK_DGRAM, CAN_ISOTP)) {
  can_isotp_fc_options flow{};
  flow.stmin = static_cast<std::uint8_t>(separation_ms);
  set(socket_.number(), SOL_CAN_ISOTP, CAN_ISOTP_RECV_FC, flow);
  if (fd) {
    can_isotp_ll_options frames{};
    frames.mtu = CANFD_MTU;
    frames.tx_dl = CANFD_MAX_DLEN;
    set(socket_.number(), SOL_CAN_ISOTP, CAN_ISOTP_LL_OPTS, frames);
  }
  sockaddr_can address = address_of(interface);
  address.can_addr.tp.tx_id = send_id;
  address.can_addr.tp.rx_id = receive_id;
  bind_to(socket_.number(), address);
}

int IsoTpSocket::send(std::string_view message) {
  const ssize_t count = write(socket_.number(), message.data(), message.size());
  return count == static_cast<ssize_t>(message.size()) ? 0 : errno;
}

int IsoTpSocket::receive(std::string& message) {
  message.resize(8192);
  const ssize_t count = read(socket_.number(), message.data(), message.size());
  message.resize(count > 0 ? static_cast<std::size_t>(count) : 0);
  return count < 0 ? errno : 0;
}

}  // namespace throwcal
