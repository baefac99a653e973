// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/can_client.h"

#include <poll.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <functional>
#include <random>
#include <system_error>

#include "firmware/box_client.h"

namespace throwcal {
namespace {

using namespace std::chrono_literals;
using Json = nlohmann::ordered_json;

constexpr auto answer_time = 500ms;  ///< after which a command is sent again
/// Between two frames of a document: half of a bus of 250 kbit/s stays free.
constexpr int separation_ms = 1;

CanInterface usable(const CanClientSettings& settings) {
  const CanInterface out = look_at_can(settings.interface, false);
  if (out.condition != CanCondition::up) throw BoxError(out.problem);
  return out;
}

/// Without a filter for each: 32 identifiers are one unit's.
CanSocket opened(const CanClientSettings& settings, const CanInterface& interface) try {
  std::vector<std::uint32_t> ids;
  for (int offset = 0; offset < can_ids_a_unit; ++offset)
    if (offset != can_command && offset != can_document && offset != can_flow_control)
      ids.push_back(can_base_id(settings.unit) + static_cast<std::uint32_t>(offset));
  return CanSocket(interface, ids, false, false);
} catch (const std::system_error& error) {
  throw BoxError(settings.interface + " can't be opened: " + error.what());
}

Json known(const std::optional<double>& value) { return value ? Json(*value) : Json(nullptr); }

Json whole(const std::optional<double>& value) {
  return value ? Json(std::llround(*value)) : Json(nullptr);
}

Json known(const std::array<std::optional<double>, 3>& values) {
  if (!values[0] || !values[1] || !values[2]) return nullptr;
  return Json::array({*values[0], *values[1], *values[2]});
}

Json to_json(const CanCamera& camera, std::size_t number) {
  return {{"camera", number},
          {"translation_m", known(camera.position.translation_m)},
          {"rotation_vector_rad", known(camera.rotation.rotation_rad)},
          {"sigma_position_m", known(camera.quality.sigma_position_m)},
          {"sigma_rotation_rad", known(camera.quality.sigma_rotation_rad)},
          {"reprojection_rms_px", known(camera.quality.reprojection_rms_px)},
          {"sightings_used", whole(camera.quality.sightings_used)},
          {"clamped", camera.quality.clamped},
          {"sequence", camera.quality.sequence}};
}

}  // namespace

CanClient::CanClient(CanClientSettings settings)
    : settings_(std::move(settings)),
      interface_(usable(settings_)),
      socket_(opened(settings_, interface_)),
      sequence_(static_cast<int>(std::random_device()() % 256)) {
  report_.cameras.resize(can_cameras);
  listen_for("", [this] { return heard_ >> can_heartbeat & 1; });
  if (report_.heartbeat.protocol_version != can_protocol_version)
    throw BoxError("the box on " + settings_.interface + " speaks version " +
                   std::to_string(report_.heartbeat.protocol_version) +
                   " of the CAN messages; expected " + std::to_string(can_protocol_version));
}

void CanClient::is_silent(const std::string& what) const {
  throw BoxError("no box is heard on " + settings_.interface + " as unit " +
                 std::to_string(settings_.unit) + (what.empty() ? "" : " with " + what) +
                 " within " + std::to_string(settings_.patience.count() / 1000) +
                 " s; does throwcald run with [can] there, at the same bit rate?");
}

bool CanClient::wait(int fd, Clock::time_point until) const {
  for (;;) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(until - Clock::now());
    pollfd waiting{.fd = fd, .events = POLLIN, .revents = 0};
    const int ready = poll(&waiting, 1, static_cast<int>(std::max(left, 0ms).count()));
    if (ready > 0) return true;
    if (ready == 0 || errno != EINTR) return false;
  }
}

/// Takes the next frame; false where none comes.
bool CanClient::hear(Clock::time_point until) {
  if (!wait(socket_.fd(), until)) return false;
  CanSocket::Frame frame;
  const int error = socket_.receive(frame);
  if (error == EAGAIN || error == EINTR) return true;
  if (error != 0) throw BoxError(settings_.interface + ": " + std::strerror(error));
  CanPayload payload{};
  if (frame.size != payload.size()) return true;
  std::copy_n(frame.data.begin(), payload.size(), payload.begin());
  take(static_cast<int>(frame.id - can_base_id(settings_.unit)), payload);
  return true;
}

void CanClient::take(int offset, const CanPayload& payload) {
  heard_ |= std::uint64_t{1} << offset;
  if (offset == can_status) report_.status = decode<CanStatus>(payload);
  if (offset == can_health) report_.health = decode<CanHealth>(payload);
  if (offset == can_heartbeat) report_.heartbeat = decode<CanHeartbeat>(payload);
  if (offset == can_result) report_.result = decode<CanResult>(payload);
  if (offset == can_ack) ack_ = decode<CanAck>(payload);
  if (offset < can_camera) return;
  CanCamera& camera = report_.cameras.at(static_cast<std::size_t>(offset - can_camera) / 3);
  if ((offset - can_camera) % 3 == 0) camera.position = decode<CanPosition>(payload);
  if ((offset - can_camera) % 3 == 1) camera.rotation = decode<CanRotation>(payload);
  if ((offset - can_camera) % 3 == 2) camera.quality = decode<CanQuality>(payload);
}

void CanClient::listen_for(const char* what, const std::function<bool()>& is_there) {
  const auto until = Clock::now() + settings_.patience;
  while (!is_there())
    if (Clock::now() > until || !hear(until)) is_silent(what);
}

Json CanClient::status() {
  heard_ &= ~(std::uint64_t{1} << can_status);  // a fresh one, however often this is called
  const auto cameras = [this] { return std::min(report_.health.cameras, can_cameras); };
  listen_for("all its messages", [&] {
    std::uint64_t wanted = 1 << can_status | 1 << can_health | 1 << can_result;
    if (report_.status.sequence != 0)
      wanted |= ((std::uint64_t{1} << 3 * cameras()) - 1) << can_camera;
    return (heard_ & wanted) == wanted;
  });
  const CanStatus& now = report_.status;
  Json poses = Json::array();
  for (int i = 0; i < cameras() && now.sequence != 0; ++i)
    poses.push_back(to_json(report_.cameras[static_cast<std::size_t>(i)], poses.size() + 1));
  const std::string verdict = can_verdict_word(now.verdict);
  const CanHeartbeat& beat = report_.heartbeat;
  return {{"state", can_state_word(now.state)},
          {"throws", whole(now.throws)},
          {"worst_sigma_position_m", known(now.worst_sigma_position_m)},
          {"worst_sigma_rotation_rad", known(now.worst_sigma_rotation_rad)},
          {"verdict", verdict.empty() ? Json(nullptr) : Json(verdict)},
          {"fault", now.fault},
          {"calibration_problem", now.calibration_problem},
          {"cameras", report_.health.cameras},
          {"cameras_running", report_.health.cameras_running},
          {"frames_lost", whole(report_.health.frames_lost)},
          {"frames_dropped", whole(report_.health.frames_dropped)},
          {"can_frames_lost", whole(report_.health.can_frames_lost)},
          {"poses", std::move(poses)},
          {"result",
           {{"sequence", report_.result.sequence},
            {"length", report_.result.length},
            {"crc32", report_.result.crc32}}},
          {"uptime_s", beat.uptime_s},
          {"software", "throwcal " + std::to_string(beat.major) + "." + std::to_string(beat.minor) +
                           "." + std::to_string(beat.patch)}};
}

/// Sent again until it is answered: the box does it once.
CanAck CanClient::ask(CanOrder order, int argument, std::uint32_t key) {
  const CanCommand command{static_cast<int>(order), sequence_, argument, key};
  sequence_ = (sequence_ + 1) % 256;
  const auto deadline = Clock::now() + settings_.patience;
  while (Clock::now() < deadline) {
    ack_.reset();
    const int error = socket_.send(can_base_id(settings_.unit) + can_command, encode(command));
    if (error != 0 && error != ENOBUFS && error != EAGAIN)
      throw BoxError(settings_.interface + ": " + std::strerror(error));
    const auto until = Clock::now() + answer_time;
    while (hear(until) && Clock::now() < until)
      if (ack_ && ack_->order == command.order && ack_->sequence == command.sequence) return *ack_;
  }
  throw BoxError("the box on " + settings_.interface + " does not answer a command");
}

CanAck CanClient::order(CanOrder order, std::uint32_t key) {
  const CanAck ack = ask(order, 0, key);
  if (ack.outcome == CanOutcome::ok) return ack;
  std::string why = "the box says: " + to_string(ack.outcome);
  if (ack.outcome == CanOutcome::forbidden)
    why += "; show its token (--token), or press its button and ask again within 60 s";
  if (ack.outcome == CanOutcome::refused) why += ", it is " + can_state_word(ack.state);
  if (ack.outcome == CanOutcome::locked) why += " after wrong keys; ask again in 10 s";
  throw BoxError(why);
}

/// The transfer that was just asked for; nothing where it broke off.
std::optional<std::string> CanClient::block(IsoTpSocket& isotp) {
  const auto until = Clock::now() + settings_.patience;
  std::string out;
  while (wait(isotp.fd(), until)) {
    const int error = isotp.receive(out);
    if (error == 0) return out;
    if (error != EAGAIN && error != EINTR) return {};
  }
  return {};
}

std::string CanClient::document() {
  const std::uint32_t base = can_base_id(settings_.unit);
  std::optional<IsoTpSocket> isotp;
  try {
    isotp.emplace(interface_, base + can_flow_control, base + can_document, report_.heartbeat.fd,
                  separation_ms);
  } catch (const std::system_error& error) {
    throw BoxError(error.code().value() == EPROTONOSUPPORT
                       ? "this machine's kernel has no ISO-TP: modprobe can-isotp"
                       : std::string("no ISO-TP: ") + error.what());
  }
  CanDocumentReader reader;
  for (int failures = 0; !reader.is_complete();) {
    const CanAck ack = ask(CanOrder::document, reader.wanted(), 0);
    if (ack.outcome == CanOutcome::refused && reader.wanted() == 0)
      throw BoxError("the box has no calibration that it hands out");
    if (ack.outcome == CanOutcome::unsupported)
      throw BoxError("the box's kernel has no ISO-TP (module can-isotp)");
    const bool is_coming = ack.outcome == CanOutcome::ok;
    const auto came = is_coming ? block(*isotp) : std::nullopt;
    if (came && reader.add(*came) == CanDocumentReader::Outcome::taken) continue;
    if (++failures > 10)
      throw BoxError("the document does not come through on " + settings_.interface);
    if (ack.outcome == CanOutcome::busy)  // another client's, or one that broke off
      for (const auto until = Clock::now() + answer_time; hear(until) && Clock::now() < until;) {
      }
  }
  return reader.text();
}

}  // namespace throwcal
