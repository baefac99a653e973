// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/can_link.h"

#include <sys/epoll.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <system_error>

#include "firmware/crc32.h"
#include "firmware/export.h"

namespace throwcal {
namespace {

using namespace std::chrono_literals;

constexpr auto period = 100ms;
constexpr std::uint64_t second = 10, longest_between_results = 10 * second;  // in periods
/// More than any client sends; a bus full of commands must not keep the box busy.
constexpr int commands_a_period = 16;
constexpr int frames_a_turn = 64;

}  // namespace

CanLink::CanLink(EventLoop& loop, const CanSettings& settings, JsonRpc& rpc,
                 std::uint32_t short_key)
    : loop_(loop),
      settings_(settings),
      rpc_(rpc),
      bus_(settings.interface),
      orders_(rpc, short_key, [this](int block) { return send_block(block); }),
      timer_(loop.on_timer(0ms, [this] { tick(); })) {}

CanLink::~CanLink() {
  io_ = {};
  isotp_io_ = {};
}

std::uint32_t CanLink::id(int offset) const {
  return can_base_id(settings_.unit) + static_cast<std::uint32_t>(offset);
}

void CanLink::tick() {
  const auto now = Clock::now();
  next_tick_ = std::max(next_tick_ + period, now);
  timer_.after(std::chrono::ceil<std::chrono::microseconds>(next_tick_ - now));
  commands_left_ = commands_a_period;
  if (tenth_ >= next_look_) look_after_interface();
  if (socket_) {
    renew_report();
    tell_report();
  }
  ++tenth_;
}

/// Once a second, open or not: it may be gone, back, or another one under the same name. Not sooner
/// after it was closed: the kernel takes a while to notice that a controller has no carrier.
void CanLink::look_after_interface() {
  next_look_ = tenth_ + second;
  const CanInterface now = look_at_can(settings_.interface, settings_.fd);
  const bool is_up = now.condition == CanCondition::up;
  if (socket_ && is_up && now.index == interface_.index) return;
  if (!is_up) return close(now);
  if (socket_)
    close({now.index, CanCondition::missing, settings_.interface + " is another interface now"});
  open(now);
}

void CanLink::open(const CanInterface& interface) {
  interface_ = interface;
  try {
    socket_.emplace(interface, std::vector{id(can_command)}, true, settings_.fd);
    io_ = loop_.on_io(socket_->fd(), EPOLLIN, [this](std::uint32_t) { read(); });
  } catch (const std::system_error& error) {
    return close({interface.index, CanCondition::unusable,
                  settings_.interface + " can't be opened: " + error.what()});
  }
  bus_.opened();
  open_isotp();
}

/// Without it all but documents goes on.
void CanLink::open_isotp() {
  try {
    isotp_.emplace(interface_, id(can_document), id(can_flow_control), settings_.fd);
    isotp_io_ = loop_.on_io(isotp_->fd(), EPOLLIN, [this](std::uint32_t) { read_isotp(); });
    isotp_problem_.clear();
  } catch (const std::system_error& error) {
    isotp_.reset();
    isotp_problem_ = error.code().value() == EPROTONOSUPPORT
                         ? "this kernel has no ISO-TP (module can-isotp)"
                         : std::string("no ISO-TP: ") + error.what();
    once_.warning("isotp", "CAN: " + isotp_problem_ + "; documents can't be fetched by CAN");
  }
}

void CanLink::close(const CanInterface& now) {
  io_ = {};
  isotp_io_ = {};
  socket_.reset();
  isotp_.reset();
  next_look_ = tenth_ + second;
  bus_.closed(now);
}

void CanLink::renew_report() {
  JsonRpc::Caller reader;
  const Json status = rpc_.call("status.get", {}, reader);
  if (has_other_result(status) || tenth_ - result_renewed_at_ >= longest_between_results)
    renew_result();
  const int alive = report_.status.alive + 1, beat = report_.heartbeat.alive;
  report_.status = can_status_of(status);
  report_.status.alive = alive % 16;
  report_.status.sequence = newest_.sequence;
  report_.health = can_health_of(status);
  report_.health.can_frames_lost = static_cast<double>(bus_.frames_lost());
  report_.health.cameras_clamped = static_cast<int>(
      std::ranges::count_if(report_.cameras, [](const auto& c) { return c.quality.clamped; }));
  report_.heartbeat = can_heartbeat_of(status);
  report_.heartbeat.fd = settings_.fd;
  report_.heartbeat.alive = (beat + (tenth_ % second == 0)) % 128;
}

/// Whether the latest calibration may be another one: to ask for it costs more than to ask this. A
/// deleted session is not seen here, but by the next renewal.
bool CanLink::has_other_result(const Json& status) {
  Json now;
  for (const char* key : {"calibration", "session", "calibration_problem"})
    now[key] = status.value(key, Json());
  if (now == result_of_) return false;
  result_of_ = std::move(now);
  return true;
}

/// The text is that of the TCP link, byte for byte.
void CanLink::renew_result() {
  if (result_renewed_at_ == tenth_ && tenth_ > 0) return;
  result_renewed_at_ = tenth_;
  std::string text;
  try {
    JsonRpc::Caller reader;
    const Json document = rpc_.call("calibration.latest", {}, reader);
    text = JsonRpc::to_line(document);
    if (text == newest_.text) return;
    if (text.size() > can_document_bytes)
      throw std::length_error("the calibration is too long for CAN");
    report_.cameras = can_cameras_of(to_calibration(document, "the calibration"),
                                     last_sequence_ % can_sequences + 1);
  } catch (const RpcError&) {  // there is none, or none of these cameras
    text.clear();
  } catch (const std::exception& error) {
    once_.warning("result", std::string("CAN: ") + error.what());
    text.clear();
  }
  set_result(std::move(text));
}

void CanLink::set_result(std::string text) {
  if (text.empty()) {
    newest_ = {};
    report_.cameras.clear();
  } else {
    last_sequence_ = last_sequence_ % can_sequences + 1;
    newest_ = {last_sequence_, std::move(text), 0};
    newest_.crc32 = crc32(newest_.text);
  }
  report_.result = {newest_.sequence, static_cast<std::uint32_t>(newest_.text.size()),
                    newest_.crc32};
}

/// Where the queue is full the rest of the turn is lost, too: no second try, the next turn's is
/// newer.
void CanLink::tell_report() {
  bool is_taken = true;
  for (const CanFrame& frame : frames_due(report_, tenth_)) {
    if (!socket_) return;
    if (is_taken)
      is_taken = send(frame.offset, frame.payload);
    else
      bus_.sent(ENOBUFS);
  }
}

bool CanLink::send(int offset, const CanPayload& payload) {
  const int error = socket_->send(id(offset), payload);
  if (!bus_.sent(error)) give_up(error);
  return error == 0;
}

/// The socket is good for nothing any more; another one may be, in a second.
void CanLink::give_up(int error) {
  CanInterface now = look_at_can(settings_.interface, settings_.fd);
  if (now.condition == CanCondition::up)
    now = {now.index, CanCondition::down, settings_.interface + ": " + std::strerror(error)};
  close(now);
}

void CanLink::read() {
  CanSocket::Frame frame;
  for (int i = 0; i < frames_a_turn && socket_; ++i) {
    const int error = socket_->receive(frame);
    if (error == EAGAIN || error == EINTR) return;
    if (error != 0) return give_up(error);
    if (!frame.is_error)
      obey(frame);
    else if (!bus_.heard(frame))
      close({interface_.index, CanCondition::bus_off,
             settings_.interface + " is off the bus (bus-off)"});
  }
}

void CanLink::obey(const CanSocket::Frame& frame) {
  if (commands_left_ == 0) {
    ++commands_ignored_;
    once_.warning("commands", "CAN: more commands than anybody needs; the rest is ignored");
    return;
  }
  --commands_left_;
  const CanAck ack = orders_.answer(frame.data.data(), frame.size, Clock::now());
  if (ack.outcome == CanOutcome::forbidden || ack.outcome == CanOutcome::locked)
    once_.warning("key", "CAN: a command came without the box's key");
  if (socket_) send(can_ack, encode(ack));
}

/// Nobody has anything to say to us by ISO-TP; how a transfer ended is told as an error. The next
/// block gets a socket of its own: one that has lost its interface would report that for ever.
void CanLink::read_isotp() {
  std::string anything;
  const int error = isotp_->receive(anything);
  if (error == 0 || error == EAGAIN || error == EINTR) return;
  isotp_io_ = {};
  isotp_.reset();
  if (error == ENETDOWN || error == ENODEV || error == EADDRNOTAVAIL) return;  // the bus' fault
  ++transfers_failed_;
  once_.warning("transfer",
                std::string("CAN: a document was not taken to its end: ") + std::strerror(error));
}

CanOutcome CanLink::send_block(int number) {
  if (!isotp_ && socket_) open_isotp();
  if (!isotp_) return CanOutcome::unsupported;
  if (number == 0) {
    renew_result();
    sending_ = newest_;
  }
  if (sending_.sequence == 0 || number >= sending_.blocks()) return CanOutcome::refused;
  const int error = isotp_->send(sending_.block(number));
  if (error == EAGAIN) return CanOutcome::busy;
  if (error != 0) {
    ++transfers_failed_;
    return CanOutcome::refused;
  }
  ++blocks_sent_;
  return CanOutcome::ok;
}

Json CanLink::status() const {
  Json out = bus_.to_json();
  out["unit"] = settings_.unit;
  out["fd"] = settings_.fd;
  out["commands"] = orders_.commands();
  out["commands_ignored"] = commands_ignored_;
  out["wrong_keys"] = orders_.wrong_keys();
  out["blocks_sent"] = blocks_sent_;
  out["transfers_failed"] = transfers_failed_;
  out["isotp_problem"] = isotp_problem_.empty() ? Json(nullptr) : Json(isotp_problem_);
  return out;
}

}  // namespace throwcal
