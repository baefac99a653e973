// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/calibration_table.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <vector>

#include "estimator/rigid.h"
#include "firmware/export.h"

namespace throwcal {
namespace {

template <typename... Values>
std::string formatted(const char* format, Values... values) {
  char text[128];
  std::snprintf(text, sizeof text, format, values...);
  return text;
}

/// Roll, pitch and yaw of a camera [deg]: yaw of its viewing direction about the vertical from
/// world x towards y, pitch of it above the horizon, roll of the picture about it.
Eigen::Vector3d roll_pitch_yaw_deg(const Eigen::Matrix3d& rotation) {
  const Eigen::Vector3d right = rotation.col(0), down = rotation.col(1), forward = rotation.col(2);
  const double pitch = std::atan2(forward.z(), std::hypot(forward.x(), forward.y()));
  return Eigen::Vector3d(std::atan2(-right.z(), -down.z()), pitch,
                         std::atan2(forward.y(), forward.x())) *
         180.0 / std::numbers::pi;
}

using Row = std::vector<std::string>;

Row header_row(bool with_truth) {
  Row row{"camera",  "x m",      "y m",        "z m",       "roll deg", "pitch deg",
          "yaw deg", "sigma mm", "sigma mrad", "offset ms", "sigma ms", "rms px"};
  if (with_truth)
    for (const char* name : {"| error mm", "error mrad", "in sigmas", "offset error ms"})
      row.push_back(name);
  return row;
}

Row camera_row(const CameraCalibration& camera) {
  Row row{camera.name};
  if (camera.T_world_cam) {
    const Eigen::Vector3d t = camera.T_world_cam->translation;
    const Eigen::Vector3d angles = roll_pitch_yaw_deg(camera.T_world_cam->rotation);
    for (const double value : {t.x(), t.y(), t.z()}) row.push_back(formatted("%.4f", value));
    for (const double value : angles) row.push_back(formatted("%.3f", value));
  } else {
    row.insert(row.end(), 6, "?");
  }
  const auto sigma = sigma_of(camera);
  row.push_back(sigma ? formatted("%.2f", 1e3 * sigma->position_m) : "?");
  row.push_back(sigma ? formatted("%.2f", 1e3 * sigma->rotation_rad) : "?");
  row.push_back(formatted("%.3f", 1e3 * camera.time_offset_s));
  row.push_back(camera.sigma_time_offset_s ? formatted("%.3f", 1e3 * *camera.sigma_time_offset_s)
                                           : "-");
  row.push_back(camera.sightings_used ? formatted("%.2f", camera.reprojection_rms_px) : "-");
  return row;
}

void append_error(Row& row, const CameraCalibration& camera, const Calibration& truth) {
  const auto found = std::ranges::find(truth.cameras, camera.name, &CameraCalibration::name);
  if (found == truth.cameras.end() || !found->T_world_cam || !camera.T_world_cam) {
    row.insert(row.end(), {"| ?", "?", "?", "?"});
    return;
  }
  const CameraError error = error_of(camera, *found);
  row.push_back(formatted("| %.2f", 1e3 * error.position_m));
  row.push_back(formatted("%.2f", 1e3 * error.rotation_rad));
  row.push_back(error.worst_sigmas ? formatted("%.1f", *error.worst_sigmas) : "?");
  row.push_back(formatted("%.3f", 1e3 * error.time_offset_s));
}

/// Columns as wide as their widest cell, the first to the left, numbers to the right.
std::string aligned(const std::vector<Row>& rows) {
  std::vector<std::size_t> width(rows.front().size());
  for (const Row& row : rows)
    for (std::size_t i = 0; i < row.size(); ++i) width[i] = std::max(width[i], row[i].size());
  std::string out;
  for (const Row& row : rows) {
    for (std::size_t i = 0; i < row.size(); ++i) {
      const std::string blank(width[i] - row[i].size(), ' ');
      out += i == 0 ? row[i] + blank : "  " + blank + row[i];
    }
    out += '\n';
  }
  return out;
}

}  // namespace

std::optional<CameraSigma> sigma_of(const CameraCalibration& camera) {
  if (!camera.covariance) return {};
  const Eigen::Matrix<double, 6, 1> variance = camera.covariance->diagonal();
  return CameraSigma{std::sqrt(variance.head<3>().sum()), std::sqrt(variance.tail<3>().sum())};
}

CameraError error_of(const CameraCalibration& estimate, const CameraCalibration& truth) {
  const Rigid &a = estimate.T_world_cam.value(), &b = truth.T_world_cam.value();
  Eigen::Matrix<double, 6, 1> error;
  error << b.translation - a.translation, log_so3(b.rotation * a.rotation.transpose());
  CameraError out{error.head<3>().norm(),
                  error.tail<3>().norm(),
                  estimate.time_offset_s - truth.time_offset_s,
                  {}};
  if (!estimate.covariance) return out;
  for (int i = 0; i < 6; ++i) {
    const double variance = (*estimate.covariance)(i, i);
    if (variance > 1e-18)  // what is fixed by definition has none
      out.worst_sigmas =
          std::max(out.worst_sigmas.value_or(0.0), std::abs(error[i]) / std::sqrt(variance));
  }
  return out;
}

std::string calibration_table(const Calibration& calibration,
                              const std::optional<Calibration>& truth) {
  std::vector<Row> rows{header_row(truth.has_value())};
  for (const CameraCalibration& camera : calibration.cameras) {
    rows.push_back(camera_row(camera));
    if (truth) append_error(rows.back(), camera, *truth);
  }
  std::string out = aligned(rows) + "drag " + formatted("%.5f", calibration.drag_per_m) + " /m";
  if (calibration.sigma_drag_per_m)
    out += " (sigma " + formatted("%.5f", *calibration.sigma_drag_per_m) + ")";
  out += "\n";
  for (const CameraCalibration& camera : calibration.cameras)
    for (const LensEstimate& lens : camera.lens)
      out += camera.name + " " + lens.name + " " + formatted("%.6g", lens.value) + " (sigma " +
             formatted("%.2g", lens.sigma) + ")\n";
  out += "verdict: " + to_string(calibration.verdict) + "\n";
  for (const std::string& reason : calibration.reasons) out += "  " + reason + "\n";
  if (calibration.next_throw && calibration.verdict != Verdict::accepted)
    out += "next: " + calibration.next_throw->text + "\n";
  return out;
}

}  // namespace throwcal
