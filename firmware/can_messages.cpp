// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/can_messages.h"

#include <algorithm>
#include <cmath>

namespace throwcal {
namespace {

constexpr std::array<std::string_view, 7> states{"idle",    "warming-up", "capturing", "throw-seen",
                                                 "solving", "done",       "fault"};
constexpr std::array<std::string_view, 5> verdicts{"", "accepted", "needs-more-throws",
                                                   "unobservable", "rejected"};
constexpr std::array<std::string_view, 8> outcomes{
    "ok", "refused", "forbidden", "unknown command", "malformed", "locked", "busy", "unsupported"};

constexpr double hundredth = 0.01, position_m = 1e-4, rotation_rad = 6e-6, sigma = 1e-5;

std::int64_t largest(int bits, bool is_signed) {
  return is_signed ? (std::int64_t{1} << (bits - 1)) - 1 : (std::int64_t{1} << bits) - 2;
}
std::int64_t lowest(int bits, bool is_signed) { return is_signed ? -largest(bits, true) : 0; }
std::int64_t unknown(int bits, bool is_signed) {
  return is_signed ? -largest(bits, true) - 1 : largest(bits, false) + 1;
}

/// Writes the numbers that describe() names.
class Packer {
 public:
  template <typename Whole>
  void whole(const char*, int bits, const Whole& value) {
    const std::int64_t given = static_cast<std::int64_t>(value), most = largest(bits, false) + 1;
    put(bits, std::clamp<std::int64_t>(given, 0, most));
    clamped |= given < 0 || given > most;
  }
  void number(const char*, int bits, bool is_signed, double scale,
              const std::optional<double>& value) {
    if (!value || !std::isfinite(*value)) return put(bits, unknown(bits, is_signed));
    const double low = static_cast<double>(lowest(bits, is_signed)),
                 high = static_cast<double>(largest(bits, is_signed));
    const double count = std::round(*value / scale);
    clamped |= count < low || count > high;
    put(bits, static_cast<std::int64_t>(std::clamp(count, low, high)));
  }
  CanPayload payload() const {
    CanPayload out;
    for (std::size_t i = 0; i < out.size(); ++i) out[i] = static_cast<std::uint8_t>(word_ >> 8 * i);
    return out;
  }
  bool clamped = false;

 private:
  void put(int bits, std::int64_t value) {
    const std::uint64_t mask = (std::uint64_t{1} << bits) - 1;
    word_ |= (static_cast<std::uint64_t>(value) & mask) << start_;
    start_ += bits;
  }

  std::uint64_t word_ = 0;
  int start_ = 0;
};

class Unpacker {
 public:
  explicit Unpacker(const CanPayload& payload) {
    for (std::size_t i = 0; i < payload.size(); ++i) word_ |= std::uint64_t{payload[i]} << 8 * i;
  }
  template <typename Whole>
  void whole(const char*, int bits, Whole& value) {
    value = static_cast<Whole>(take(bits));
  }
  void number(const char*, int bits, bool is_signed, double scale, std::optional<double>& value) {
    std::int64_t count = take(bits);
    if (is_signed && count > largest(bits, true)) count -= std::int64_t{1} << bits;
    value.reset();
    if (count == unknown(bits, is_signed)) return;
    // In millionths, so that 831 tenths of a millimetre are 0.0831 and not 0.08310000000000001.
    value = static_cast<double>(count) * std::round(1e6 * scale) / 1e6;
  }

 private:
  std::int64_t take(int bits) {
    const std::uint64_t mask = (std::uint64_t{1} << bits) - 1;
    const auto out = static_cast<std::int64_t>(word_ >> start_ & mask);
    start_ += bits;
    return out;
  }

  std::uint64_t word_ = 0;
  int start_ = 0;
};

class Lister {
 public:
  template <typename Whole>
  void whole(const char* name, int bits, Whole&) {
    add(name, bits, false, 1.0);
  }
  void number(const char* name, int bits, bool is_signed, double scale, std::optional<double>&) {
    add(name, bits, is_signed, scale);
  }
  std::vector<CanSignal> signals;

 private:
  void add(const char* name, int bits, bool is_signed, double scale) {
    const int start = signals.empty() ? 0 : signals.back().start + signals.back().bits;
    signals.push_back({name, start, bits, is_signed, scale});
  }
};

template <typename Fields>
void describe(CanStatus& m, Fields& f) {
  f.whole("state", 4, m.state);
  f.whole("verdict", 3, m.verdict);
  f.whole("fault", 1, m.fault);
  f.whole("calibration_problem", 1, m.calibration_problem);
  f.whole("clamped", 1, m.clamped);
  f.whole("sequence", 4, m.sequence);
  f.number("throws", 14, false, 1.0, m.throws);
  f.number("worst_sigma_position_m", 16, false, sigma, m.worst_sigma_position_m);
  f.number("worst_sigma_rotation_rad", 16, false, sigma, m.worst_sigma_rotation_rad);
  f.whole("alive", 4, m.alive);
}

template <typename Fields>
void describe(CanHealth& m, Fields& f) {
  f.whole("cameras", 7, m.cameras);
  f.whole("cameras_running", 7, m.cameras_running);
  f.number("frames_lost", 16, false, 1.0, m.frames_lost);
  f.number("frames_dropped", 16, false, 1.0, m.frames_dropped);
  f.number("can_frames_lost", 14, false, 1.0, m.can_frames_lost);
  f.whole("cameras_clamped", 4, m.cameras_clamped);
}

template <typename Fields>
void describe(CanHeartbeat& m, Fields& f) {
  f.whole("uptime_s", 24, m.uptime_s);
  f.whole("protocol_version", 8, m.protocol_version);
  f.whole("software_major", 8, m.major);
  f.whole("software_minor", 8, m.minor);
  f.whole("software_patch", 8, m.patch);
  f.whole("fd", 1, m.fd);
  f.whole("alive", 7, m.alive);
}

template <typename Fields>
void describe(CanCommand& m, Fields& f) {
  f.whole("order", 8, m.order);
  f.whole("sequence", 8, m.sequence);
  f.whole("argument", 16, m.argument);
  f.whole("key", 32, m.key);
}

template <typename Fields>
void describe(CanAck& m, Fields& f) {
  f.whole("order", 8, m.order);
  f.whole("sequence", 8, m.sequence);
  f.whole("outcome", 8, m.outcome);
  f.whole("state", 8, m.state);
  f.whole("session", 32, m.session);
}

template <typename Fields>
void describe(CanResult& m, Fields& f) {
  f.whole("sequence", 8, m.sequence);
  f.whole("length", 24, m.length);
  f.whole("crc32", 32, m.crc32);
}

template <typename Fields>
void describe(CanPosition& m, Fields& f) {
  f.number("x_m", 20, true, position_m, m.translation_m[0]);
  f.number("y_m", 20, true, position_m, m.translation_m[1]);
  f.number("z_m", 20, true, position_m, m.translation_m[2]);
  f.whole("sequence", 4, m.sequence);
}

template <typename Fields>
void describe(CanRotation& m, Fields& f) {
  f.number("rx_rad", 20, true, rotation_rad, m.rotation_rad[0]);
  f.number("ry_rad", 20, true, rotation_rad, m.rotation_rad[1]);
  f.number("rz_rad", 20, true, rotation_rad, m.rotation_rad[2]);
  f.whole("sequence", 4, m.sequence);
}

template <typename Fields>
void describe(CanQuality& m, Fields& f) {
  f.number("sigma_position_m", 16, false, sigma, m.sigma_position_m);
  f.number("sigma_rotation_rad", 16, false, sigma, m.sigma_rotation_rad);
  f.number("reprojection_rms_px", 12, false, hundredth, m.reprojection_rms_px);
  f.number("sightings_used", 14, false, 1.0, m.sightings_used);
  f.whole("valid", 1, m.valid);
  f.whole("clamped", 1, m.clamped);
  f.whole("sequence", 4, m.sequence);
}

template <typename Words>
int code_of(const Words& words, std::string_view word, int otherwise) {
  const auto found = std::ranges::find(words, word);
  return found == words.end() ? otherwise : static_cast<int>(found - words.begin());
}

template <typename Words>
std::string word_of(const Words& words, int code, const char* otherwise) {
  const bool known = code >= 0 && code < static_cast<int>(words.size());
  return known ? std::string(words[static_cast<std::size_t>(code)]) : otherwise;
}

}  // namespace

template <typename Message>
bool is_clamped(const Message& message) {
  Message copy = message;
  Packer packer;
  describe(copy, packer);
  return packer.clamped;
}

template <typename Message>
CanPayload encode(const Message& message) {
  Message copy = message;
  if constexpr (requires { copy.clamped; }) copy.clamped |= is_clamped(message);
  Packer packer;
  describe(copy, packer);
  return packer.payload();
}

template <typename Message>
Message decode(const CanPayload& payload) {
  Message out;
  Unpacker unpacker(payload);
  describe(out, unpacker);
  return out;
}

template <typename Message>
std::vector<CanSignal> can_signals() {
  Message any;
  Lister lister;
  describe(any, lister);
  return lister.signals;
}

#define THROWCAL_CAN_MESSAGE(Message)                  \
  template bool is_clamped(const Message&);            \
  template CanPayload encode(const Message&);          \
  template Message decode<Message>(const CanPayload&); \
  template std::vector<CanSignal> can_signals<Message>()

THROWCAL_CAN_MESSAGE(CanStatus);
THROWCAL_CAN_MESSAGE(CanHealth);
THROWCAL_CAN_MESSAGE(CanHeartbeat);
THROWCAL_CAN_MESSAGE(CanCommand);
THROWCAL_CAN_MESSAGE(CanAck);
THROWCAL_CAN_MESSAGE(CanResult);
THROWCAL_CAN_MESSAGE(CanPosition);
THROWCAL_CAN_MESSAGE(CanRotation);
THROWCAL_CAN_MESSAGE(CanQuality);

int can_state_code(std::string_view state) { return code_of(states, state, can_unknown); }
int can_verdict_code(std::string_view verdict) {
  return code_of(verdicts, verdict, can_verdict_unknown);
}
std::string can_state_word(int code) { return word_of(states, code, "unknown"); }
std::string can_verdict_word(int code) { return word_of(verdicts, code, "unknown"); }
std::string to_string(CanOutcome outcome) {
  return word_of(outcomes, static_cast<int>(outcome), "an unknown outcome");
}

}  // namespace throwcal
