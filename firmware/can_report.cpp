// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/can_report.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "estimator/rigid.h"
#include "firmware/calibration_table.h"

namespace throwcal {
namespace {

using Json = nlohmann::ordered_json;

std::optional<double> number(const Json& object, const char* key) {
  if (!object.is_object() || !object.contains(key) || !object[key].is_number()) return {};
  return object[key].get<double>();
}

std::string word(const Json& object, const char* key) {
  if (!object.is_object() || !object.contains(key) || !object[key].is_string()) return {};
  return object[key].get<std::string>();
}

bool is_told(const Json& object, const char* key) {
  return object.is_object() && object.contains(key) && !object[key].is_null();
}

const Json& cameras_in(const Json& status) {
  static const Json none = Json::array();
  return is_told(status, "cameras") && status["cameras"].is_array() ? status["cameras"] : none;
}

CanCamera camera_of(const CameraCalibration& camera, int sequence) {
  CanCamera out;
  if (camera.T_world_cam) {
    const Eigen::Vector3d rotation = log_so3(camera.T_world_cam->rotation);
    for (int i = 0; i < 3; ++i) {
      out.position.translation_m[static_cast<std::size_t>(i)] = camera.T_world_cam->translation[i];
      out.rotation.rotation_rad[static_cast<std::size_t>(i)] = rotation[i];
    }
    out.quality.valid = true;
  }
  if (const auto sigma = sigma_of(camera)) {
    out.quality.sigma_position_m = sigma->position_m;
    out.quality.sigma_rotation_rad = sigma->rotation_rad;
  }
  if (camera.sightings_used > 0) out.quality.reprojection_rms_px = camera.reprojection_rms_px;
  out.quality.sightings_used = camera.sightings_used;
  out.position.sequence = out.rotation.sequence = out.quality.sequence = sequence;
  out.quality.clamped =
      is_clamped(out.position) || is_clamped(out.rotation) || is_clamped(out.quality);
  return out;
}

}  // namespace

CanStatus can_status_of(const Json& status) {
  CanStatus out;
  out.state = can_state_code(word(status, "state"));
  out.verdict = can_verdict_code(word(status, "verdict"));
  out.fault = is_told(status, "fault");
  out.calibration_problem = is_told(status, "calibration_problem");
  out.throws = number(status, "throws");
  out.worst_sigma_position_m = number(status, "worst_sigma_position_m");
  out.worst_sigma_rotation_rad = number(status, "worst_sigma_rotation_rad");
  return out;
}

CanHealth can_health_of(const Json& status) {
  CanHealth out;
  double lost = 0.0, dropped = 0.0;
  for (const Json& camera : cameras_in(status)) {
    ++out.cameras;
    out.cameras_running += is_told(camera, "running") && camera["running"] == true;
    lost += number(camera, "frames_lost_by_driver").value_or(0.0) +
            number(camera, "frames_damaged").value_or(0.0);
    dropped += number(camera, "frames_dropped").value_or(0.0);
  }
  out.frames_lost = lost;
  out.frames_dropped = dropped;
  return out;
}

CanHeartbeat can_heartbeat_of(const Json& status) {
  CanHeartbeat out;
  out.uptime_s = static_cast<std::uint32_t>(
      std::clamp(number(status, "uptime_s").value_or(0.0), 0.0, double{1 << 24}));
  std::sscanf(word(status, "software").c_str(), "throwcal %d.%d.%d", &out.major, &out.minor,
              &out.patch);
  return out;
}

std::vector<CanCamera> can_cameras_of(const Calibration& calibration, int sequence) {
  std::vector<CanCamera> out;
  for (const CameraCalibration& camera : calibration.cameras)
    if (out.size() < can_cameras) out.push_back(camera_of(camera, sequence));
  return out;
}

std::vector<CanFrame> frames_due(const CanReport& report, std::uint64_t tenth) {
  std::vector<CanFrame> out{{can_status, encode(report.status)}};
  if (tenth % 10 == 1) out.push_back({can_heartbeat, encode(report.heartbeat)});
  if (tenth % 10 == 3) out.push_back({can_health, encode(report.health)});
  if (tenth % 10 == 5) out.push_back({can_result, encode(report.result)});
  if (tenth % 2 == 1 || report.cameras.empty()) return out;
  const std::size_t turn = tenth / 2 % report.cameras.size();
  const CanCamera& camera = report.cameras[turn];
  const int first = can_camera + 3 * static_cast<int>(turn);
  out.push_back({first, encode(camera.position)});
  out.push_back({first + 1, encode(camera.rotation)});
  out.push_back({first + 2, encode(camera.quality)});
  return out;
}

}  // namespace throwcal
