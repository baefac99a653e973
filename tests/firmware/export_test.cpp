// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/export.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "firmware/input_error.h"

namespace throwcal {
namespace {

Calibration sample() {
  Calibration c;
  c.verdict = Verdict::needs_more_throws;
  c.reasons = {"camera \"east\" is known to 9 mm only"};
  c.gravity_mps2 = 9.81;
  c.gravity_source = "rig file";
  c.drag_per_m = 0.0175;
  CameraCalibration north;
  north.name = "north";
  // Half a turn and a bit: Eigen gives its quaternion a negative w.
  north.T_world_cam = Rigid{exp_so3({0, 0, 3.5}), {0, 0, 0}};
  Matrix6d covariance;
  for (int i = 0; i < 6; ++i)
    for (int j = 0; j < 6; ++j) covariance(i, j) = 10 * std::min(i, j) + std::max(i, j);
  north.covariance = covariance;
  north.reprojection_rms_px = 0.2;
  north.sightings_used = 240;
  CameraCalibration east;
  east.name = "east";
  east.time_offset_s = 0.004;
  east.sigma_time_offset_s = 2e-5;
  east.reprojection_rms_px = std::numeric_limits<double>::quiet_NaN();
  c.cameras = {north, east};
  ThrowEstimate thrown;
  thrown.id = "1";
  thrown.start = HostTime(from_seconds(1.5));
  thrown.end = HostTime(from_seconds(2.5));
  thrown.position_world_m = {1, 2, 3};
  thrown.cameras = {1};
  c.throws = {thrown};
  c.cameras[0].lens = {{"fx_px", 903.5, 0.4}, {"k1", -0.21, 0.003}};
  c.next_throw = NextThrow{
      {1, 2, 0.5}, {-1, 2, 4}, {0, 1}, 1, 0.007, 0.003, 0.004, 0.001, "throw from 1.0 m ahead"};
  return c;
}

TEST(Export, WritesTheKeysOfTheContractInItsOrder) {
  const Json document = to_json(sample(), "2026-01-31T12:00:00Z");
  std::vector<std::string> keys;
  for (const auto& [key, value] : document.items()) keys.push_back(key);
  EXPECT_EQ(keys, (std::vector<std::string>{"schema", "created_utc", "software", "method",
                                            "verdict", "reasons", "world", "ball", "cameras",
                                            "throws", "next_throw"}));
  EXPECT_EQ(document["schema"], "throwcal/calibration/1");
  EXPECT_EQ(document["created_utc"], "2026-01-31T12:00:00Z");
  EXPECT_EQ(document["software"], "throwcal " THROWCAL_VERSION);
  EXPECT_EQ(document["verdict"], "needs-more-throws");
  EXPECT_EQ(document["method"], "full");
  EXPECT_EQ(document["world"]["gravity_source"], "rig file");
  EXPECT_EQ(document["throws"][0]["cameras"], Json::array({"east"}));
  EXPECT_EQ(document["throws"][0]["start_s"], 1.5);
  EXPECT_EQ(document["cameras"][0]["sightings_used"], 240);
}

TEST(Export, WhatIsNotKnownIsNullNeverNan) {
  const Json document = to_json(sample(), "");
  const Json& east = document["cameras"][1];
  EXPECT_TRUE(east["T_world_cam"].is_null());
  EXPECT_TRUE(east["covariance"].is_null());
  EXPECT_TRUE(east["reprojection_rms_px"].is_null());
  EXPECT_TRUE(document["ball"]["sigma_drag_per_m"].is_null());
  EXPECT_TRUE(document["cameras"][0]["sigma_time_offset_s"].is_null());
  EXPECT_EQ(document.dump().find("nan"), std::string::npos);
}

TEST(Export, TheQuaternionsScalarIsNotNegativeAndTheCovarianceIsItsUpperTriangle) {
  const Json north = to_json(sample(), "")["cameras"][0];
  const Json& q = north["T_world_cam"]["quaternion_wxyz"];
  EXPECT_NEAR(q[0].get<double>(), -std::cos(1.75), 1e-12);
  EXPECT_NEAR(q[3].get<double>(), -std::sin(1.75), 1e-12);
  EXPECT_EQ(
      north["covariance"],
      Json::parse("[0.0,1.0,2.0,3.0,4.0,5.0,11.0,12.0,13.0,14.0,15.0,22.0,23.0,24.0,25.0,33.0,"
                  "34.0,35.0,44.0,45.0,55.0]"));
}

TEST(Export, ADocumentReadBackIsTheSameCalibration) {
  const Calibration before = sample();
  const Calibration after = to_calibration(to_json(before, ""), "c.json");
  EXPECT_EQ(after.verdict, before.verdict);
  EXPECT_EQ(after.reasons, before.reasons);
  ASSERT_EQ(after.cameras.size(), 2u);
  EXPECT_TRUE(after.cameras[0].T_world_cam->rotation.isApprox(
      before.cameras[0].T_world_cam->rotation, 1e-14));
  EXPECT_EQ(*after.cameras[0].covariance, *before.cameras[0].covariance);
  EXPECT_EQ(after.cameras[1].time_offset_s, 0.004);
  EXPECT_EQ(after.cameras[1].sigma_time_offset_s, 2e-5);
  EXPECT_FALSE(after.cameras[1].T_world_cam);
  EXPECT_EQ(after.gravity_mps2, 9.81);
  EXPECT_EQ(after.drag_per_m, 0.0175);
  ASSERT_EQ(after.throws.size(), 1u);
  EXPECT_EQ(after.throws[0].id, "1");
  EXPECT_EQ(after.throws[0].start, before.throws[0].start);
  EXPECT_EQ(after.throws[0].end, before.throws[0].end);
  EXPECT_EQ(after.throws[0].position_world_m, before.throws[0].position_world_m);
  EXPECT_EQ(after.throws[0].cameras, before.throws[0].cameras);
  ASSERT_EQ(after.cameras[0].lens.size(), 2u);
  EXPECT_EQ(after.cameras[0].lens[1].name, "k1");
  EXPECT_EQ(after.cameras[0].lens[1].value, -0.21);
  EXPECT_EQ(after.cameras[0].lens[1].sigma, 0.003);
  ASSERT_TRUE(after.next_throw);
  EXPECT_EQ(after.next_throw->cameras, before.next_throw->cameras);
  EXPECT_EQ(after.next_throw->camera, 1u);
  EXPECT_EQ(after.next_throw->velocity_world_mps, before.next_throw->velocity_world_mps);
  EXPECT_EQ(after.next_throw->expected_sigma_rotation_rad, 0.001);
  EXPECT_EQ(after.next_throw->text, "throw from 1.0 m ahead");
}

TEST(Guess, FollowsTheRigsOrderByName) {
  Calibration c = sample();
  c.cameras[1].T_world_cam = Rigid{Eigen::Matrix3d::Identity(), {4, 5, 6}};
  RigDescription rig;
  rig.cameras.resize(2);
  rig.cameras[0].name = "east";
  rig.cameras[1].name = "north";
  const Guess guess = to_guess(to_json(c, ""), rig, "guess.json");
  EXPECT_EQ(guess.T_world_cam[0].translation, Eigen::Vector3d(4, 5, 6));
  EXPECT_EQ(guess.time_offset_s, (std::vector<double>{0.004, 0.0}));
  EXPECT_EQ(guess.drag_per_m, 0.0175);
}

TEST(Guess, SaysWhatIsMissing) {
  RigDescription rig;
  rig.cameras.resize(1);
  const auto error_for = [&](const std::string& camera, const Json& document) -> std::string {
    rig.cameras[0].name = camera;
    try {
      to_guess(document, rig, "guess.json");
    } catch (const InputError& error) {
      return error.what();
    }
    return "no error";
  };
  Json document = to_json(sample(), "");
  EXPECT_EQ(error_for("south", document),
            "guess.json: camera \"south\" is missing; expected every camera of the rig file");
  EXPECT_EQ(error_for("east", document),
            "guess.json: camera \"east\" has no T_world_cam; a guess must say where every camera "
            "stands");
  document["cameras"][0]["T_world_cam"]["translation_m"] = "here";
  EXPECT_EQ(
      error_for("north", document),
      "guess.json: camera \"north\" T_world_cam translation_m must be a list of 3 numbers, got "
      "\"here\"");
  document["cameras"][0]["T_world_cam"]["translation_m"] = {0, 1e300, 0};
  EXPECT_EQ(
      error_for("north", document),
      "guess.json: camera \"north\" T_world_cam translation_m must be a number of metres from "
      "-1e+05 to 1e+05, got 1e+300");
  document["cameras"][0]["T_world_cam"]["translation_m"] = {0, 1, 0};
  document["cameras"][0]["time_offset_s"] = -11;
  EXPECT_EQ(
      error_for("north", document),
      "guess.json: camera \"north\" time_offset_s must be a number of seconds from -10 to 10, "
      "got -11");
  document["cameras"][0]["T_world_cam"]["quaternion_wxyz"] = {2, 0, 0, 0};
  EXPECT_EQ(error_for("north", document),
            "guess.json: camera \"north\" T_world_cam quaternion_wxyz must be of length 1, got 2");
  document["throws"] = nullptr;
  document["cameras"][1]["name"] = "north";
  document["cameras"][0]["T_world_cam"] = nullptr;
  EXPECT_EQ(error_for("north", document),
            "guess.json: camera \"north\" stands twice; expected it once");
  document["cameras"][1]["sightings_used"] = -1e300;
  EXPECT_EQ(error_for("north", document),
            "guess.json: camera \"north\" sightings_used must be a number from 0 to 1e+09, got "
            "-1e+300");
  document["ball"]["drag_per_m"] = 1e300;
  document["cameras"] = Json::array();
  EXPECT_EQ(error_for("north", document),
            "guess.json: drag_per_m must be a number from -1 to 10, got 1e+300");
  EXPECT_EQ(error_for("north", Json(3)), "guess.json: must be a calibration (a JSON object)");
  EXPECT_EQ(error_for("north", Json::object()), "guess.json: cameras must be a list, got nothing");
}

}  // namespace
}  // namespace throwcal
