// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/calibration_table.h"

#include <gtest/gtest.h>

namespace throwcal {
namespace {

CameraCalibration camera_at(const std::string& name, const Eigen::Vector3d& centre,
                            const Eigen::Vector3d& target, double roll_rad = 0.0) {
  CameraCalibration out;
  out.name = name;
  out.T_world_cam = look_at(centre, target, roll_rad);
  out.sightings_used = 10;
  return out;
}

TEST(CalibrationTable, SaysWhereACameraLooksInDegrees) {
  Calibration c;
  // Looks along world y, 45 degrees up, its picture turned clockwise by 0.1 rad.
  c.cameras = {camera_at("up", {1, 2, 3}, {1, 3, 4}, 0.1)};
  c.verdict = Verdict::accepted;
  const std::string table = calibration_table(c);
  EXPECT_NE(table.find("1.0000  2.0000  3.0000     5.730     45.000   90.000"), std::string::npos)
      << table;
  EXPECT_NE(table.find("verdict: accepted\n"), std::string::npos) << table;
}

TEST(CalibrationTable, AMissingPoseIsAQuestionMarkAndReasonsFollowTheVerdict) {
  Calibration c;
  c.cameras.resize(1);
  c.cameras[0].name = "lost";
  c.verdict = Verdict::unobservable;
  c.reasons = {"nobody threw"};
  const std::string table = calibration_table(c, c);
  EXPECT_NE(table.find("\nlost      ?    ?    ?         ?"), std::string::npos) << table;
  EXPECT_NE(table.find("verdict: unobservable\n  nobody threw\n"), std::string::npos) << table;
}

TEST(CameraError, IsGivenInMetresRadiansAndItsOwnSigmas) {
  const CameraCalibration truth = camera_at("a", {0, 0, 0}, {1, 0, 0});
  CameraCalibration estimate = truth;
  estimate.T_world_cam->translation = {0.003, 0, 0.004};
  estimate.T_world_cam->rotation = exp_so3({0, 0, 0.01}) * truth.T_world_cam->rotation;
  estimate.time_offset_s = 1e-4;
  Matrix6d covariance = Matrix6d::Zero();
  covariance.diagonal() << 0.001 * 0.001, 0, 0.004 * 0.004, 1e-4, 1e-4, 0.02 * 0.02;
  estimate.covariance = covariance;
  const CameraError error = error_of(estimate, truth);
  EXPECT_NEAR(error.position_m, 0.005, 1e-12);
  EXPECT_NEAR(error.rotation_rad, 0.01, 1e-12);
  EXPECT_EQ(error.time_offset_s, 1e-4);
  EXPECT_NEAR(error.worst_sigmas.value(), 3.0, 1e-9);  // x: 3 mm at a sigma of 1 mm
}

TEST(CameraSigma, IsTheNormOfThree) {
  CameraCalibration camera;
  EXPECT_FALSE(sigma_of(camera));
  Matrix6d covariance = Matrix6d::Zero();
  covariance.diagonal() << 1, 4, 4, 9, 16, 0;
  camera.covariance = covariance;
  EXPECT_EQ(sigma_of(camera)->position_m, 3.0);
  EXPECT_EQ(sigma_of(camera)->rotation_rad, 5.0);
}

}  // namespace
}  // namespace throwcal
