// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/export.h"

#include <cmath>
#include <ctime>

#include "firmware/text_file.h"

namespace throwcal {
namespace {

constexpr std::string_view schema = "throwcal/calibration/1";

Json number(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }
Json number(const std::optional<double>& value) { return value ? number(*value) : Json(nullptr); }

Json vector(const Eigen::Vector3d& v) {
  return Json::array({number(v.x()), number(v.y()), number(v.z())});
}

Json upper_triangle(const std::optional<Matrix6d>& covariance) {
  if (!covariance || !covariance->allFinite()) return nullptr;
  Json out = Json::array();
  for (int row = 0; row < 6; ++row)
    for (int column = row; column < 6; ++column) out.push_back((*covariance)(row, column));
  return out;
}

double since_start(HostTime time) { return seconds(time.time_since_epoch()); }

Json lens_of(const CameraCalibration& c) {
  Json out = Json::object();
  for (const LensEstimate& each : c.lens)
    out[each.name] = {{"value", number(each.value)}, {"sigma", number(each.sigma)}};
  return out;
}

Json camera(const CameraCalibration& c) {
  Json out = {{"name", c.name},
              {"T_world_cam", pose_to_json(c.T_world_cam)},
              {"covariance", upper_triangle(c.covariance)},
              {"time_offset_s", number(c.time_offset_s)},
              {"sigma_time_offset_s", number(c.sigma_time_offset_s)},
              {"reprojection_rms_px", number(c.reprojection_rms_px)},
              {"sightings_used", c.sightings_used},
              {"sightings_rejected", c.sightings_rejected}};
  if (!c.lens.empty()) out["lens"] = lens_of(c);
  return out;
}

Json names_of(const std::vector<CameraId>& ids, const std::vector<CameraCalibration>& cameras) {
  Json names = Json::array();
  for (const CameraId id : ids) names.push_back(cameras.at(id).name);
  return names;
}

Json next_throw_of(const std::optional<NextThrow>& t,
                   const std::vector<CameraCalibration>& cameras) {
  if (!t) return nullptr;
  return {{"position_m", vector(t->position_world_m)},
          {"velocity_mps", vector(t->velocity_world_mps)},
          {"cameras", names_of(t->cameras, cameras)},
          {"camera", cameras.at(t->camera).name},
          {"sigma_position_m", number(t->sigma_position_m)},
          {"sigma_rotation_rad", number(t->sigma_rotation_rad)},
          {"expected_sigma_position_m", number(t->expected_sigma_position_m)},
          {"expected_sigma_rotation_rad", number(t->expected_sigma_rotation_rad)},
          {"text", t->text}};
}

Json throw_of(const ThrowEstimate& t, const std::vector<CameraCalibration>& cameras) {
  return {{"id", t.id},
          {"start_s", since_start(t.start)},
          {"end_s", since_start(t.end)},
          {"position_m", vector(t.position_world_m)},
          {"velocity_mps", vector(t.velocity_world_mps)},
          {"cameras", names_of(t.cameras, cameras)},
          {"reprojection_rms_px", number(t.reprojection_rms_px)}};
}

}  // namespace

Json pose_to_json(const std::optional<Rigid>& T) {
  if (!T || !T->rotation.allFinite() || !T->translation.allFinite()) return nullptr;
  Eigen::Quaterniond q(T->rotation);
  q.normalize();
  if (q.w() < 0) q.coeffs() = -q.coeffs();
  return {{"translation_m", vector(T->translation)},
          {"quaternion_wxyz", Json::array({q.w(), q.x(), q.y(), q.z()})}};
}

std::string software_name() { return "throwcal " THROWCAL_VERSION; }

std::string utc_now() {
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  gmtime_r(&now, &utc);
  char text[32];
  return {text, std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &utc)};
}

std::string to_string(Verdict verdict) {
  switch (verdict) {
    case Verdict::accepted:
      return "accepted";
    case Verdict::needs_more_throws:
      return "needs-more-throws";
    case Verdict::unobservable:
      return "unobservable";
    case Verdict::rejected:
      return "rejected";
  }
  return "rejected";
}

std::string to_string(Method method) {
  switch (method) {
    case Method::full:
      return "full";
    case Method::rb_ekf:
      return "rb-ekf";
    case Method::r_ekf:
      return "r-ekf";
    case Method::ekf:
      return "ekf";
  }
  return "full";
}

std::optional<Method> parse_method(std::string_view text) {
  for (const Method method : {Method::full, Method::rb_ekf, Method::r_ekf, Method::ekf})
    if (to_string(method) == text) return method;
  return {};
}

Json to_json(const Calibration& c, const std::string& created_utc) {
  Json cameras = Json::array(), throws = Json::array();
  for (const CameraCalibration& each : c.cameras) cameras.push_back(camera(each));
  for (const ThrowEstimate& each : c.throws) throws.push_back(throw_of(each, c.cameras));
  return {
      {"schema", schema},
      {"created_utc", created_utc},
      {"software", software_name()},
      {"method", to_string(c.method)},
      {"verdict", to_string(c.verdict)},
      {"reasons", c.reasons},
      {"world", {{"gravity_mps2", number(c.gravity_mps2)}, {"gravity_source", c.gravity_source}}},
      {"ball",
       {{"drag_per_m", number(c.drag_per_m)}, {"sigma_drag_per_m", number(c.sigma_drag_per_m)}}},
      {"cameras", std::move(cameras)},
      {"throws", std::move(throws)},
      {"next_throw", next_throw_of(c.next_throw, c.cameras)}};
}

}  // namespace throwcal
