// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace throwcal {

/// What stands in a CAN frame: throwcal.dbc in C++, no sockets. Every message has 8 bytes; numbers
/// are packed without gaps, lowest bit first (Intel order), in the order in which a struct names
/// them. A number that does not fit is the largest that does and sets `clamped`; one that is not
/// known has a raw value of its own (the topmost of an unsigned one, the lowest of a signed one).
using CanPayload = std::array<std::uint8_t, 8>;

constexpr int can_ids_a_unit = 0x20, can_units = 12, can_cameras = 8;
constexpr std::uint32_t can_first_id = 0x680;
constexpr std::uint32_t can_base_id(int unit) {
  return can_first_id + static_cast<std::uint32_t>(unit * can_ids_a_unit);
}

/// Offsets from the base identifier of a unit.
enum CanOffset : int {
  can_status,
  can_health,
  can_heartbeat,
  can_command,
  can_ack,
  can_result,
  can_document,      ///< ISO-TP, box to client
  can_flow_control,  ///< ISO-TP, client to box
  can_camera,        ///< three of each camera: position, rotation, quality
};

constexpr int can_protocol_version = 1;
/// Results are numbered 1 to 15, then from 1 again; 0: there is none.
constexpr int can_sequences = 15;

struct CanStatus {
  int state = 0, verdict = 0;  ///< see can_states, can_verdicts
  bool fault = false, calibration_problem = false, clamped = false;
  int sequence = 0;
  std::optional<double> throws, worst_sigma_position_m, worst_sigma_rotation_rad;
  int alive = 0;  ///< counts the messages
};

struct CanHealth {
  int cameras = 0, cameras_running = 0;
  std::optional<double> frames_lost, frames_dropped, can_frames_lost;
  int cameras_clamped = 0;
};

struct CanHeartbeat {
  std::uint32_t uptime_s = 0;
  int protocol_version = can_protocol_version;
  int major = 0, minor = 0, patch = 0;
  bool fd = false;  ///< documents come in FD frames
  int alive = 0;
};

enum class CanOrder : int { start = 1, stop = 2, abort = 3, document = 4 };

struct CanCommand {
  int order = 0;          ///< a CanOrder, or what this box does not know
  int sequence = 0;       ///< the client's own; the same again is the same command
  int argument = 0;       ///< of CanOrder::document: the block wanted
  std::uint32_t key = 0;  ///< Access::short_key(); 0: none is shown
};

enum class CanOutcome : int {
  ok,
  refused,      ///< not possible now
  forbidden,    ///< a wrong key or none
  unknown,      ///< no such command
  malformed,    ///< not 8 bytes
  locked,       ///< too many wrong keys: no key is looked at for some seconds
  busy,         ///< a document is on its way
  unsupported,  ///< this machine has no ISO-TP
};

struct CanAck {
  int order = 0, sequence = 0;
  CanOutcome outcome = CanOutcome::ok;
  int state = 0;
  std::uint32_t session = 0;  ///< 0: there is none
};

/// Which document there is to fetch.
struct CanResult {
  int sequence = 0;
  std::uint32_t length = 0, crc32 = 0;
};

/// T_world_cam.
struct CanPosition {
  std::array<std::optional<double>, 3> translation_m;
  int sequence = 0;
};
struct CanRotation {
  std::array<std::optional<double>, 3> rotation_rad;  ///< a rotation vector
  int sequence = 0;
};
struct CanQuality {
  std::optional<double> sigma_position_m, sigma_rotation_rad, reprojection_rms_px, sightings_used;
  bool valid = false;    ///< its pose is known
  bool clamped = false;  ///< a number of this camera, in any of the three, does not fit
  int sequence = 0;
};

template <typename Message>
CanPayload encode(const Message& message);
template <typename Message>
Message decode(const CanPayload& payload);
/// Whether some number of it does not fit.
template <typename Message>
bool is_clamped(const Message& message);

/// Codes of the words that the status document uses; can_unknown where the code has no word for it.
constexpr int can_unknown = 15, can_verdict_unknown = 7;
int can_state_code(std::string_view state);
int can_verdict_code(std::string_view verdict);  ///< 0 of an empty text: there is none
std::string can_state_word(int code);            ///< "unknown" where there is no word
std::string can_verdict_word(int code);          ///< empty: there is none
std::string to_string(CanOutcome outcome);

/// A signal as a DBC file tells it.
struct CanSignal {
  std::string name;
  int start = 0, bits = 0;
  bool is_signed = false;
  double scale = 1.0;
};
/// Of one message: what throwcal.dbc must say.
template <typename Message>
std::vector<CanSignal> can_signals();

}  // namespace throwcal
