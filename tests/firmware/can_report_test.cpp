// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/can_report.h"

#include <gtest/gtest.h>

#include <map>

#include "estimator/rigid.h"
#include "firmware/export.h"

namespace throwcal {
namespace {

/// Of a data frame with an 11-bit identifier, with every stuff bit that there can be and the three
/// bits between frames (ISO 11898-1): 34 bits and the data are stuffed, one after each 4.
int longest_bits(int bytes) { return 47 + 8 * bytes + (34 + 8 * bytes - 1) / 4; }

CanReport report_of(std::size_t cameras) {
  Calibration calibration;
  calibration.cameras.resize(cameras);
  return {.status = {},
          .health = {},
          .heartbeat = {},
          .result = {},
          .cameras = can_cameras_of(calibration, 1)};
}

TEST(CanReport, TakesLessThanTwoPercentOfTheBus) {
  constexpr double bits_per_s = 250e3;
  for (const std::size_t cameras : {0u, 2u, 5u, 8u, 64u}) {
    const CanReport report = report_of(cameras);
    constexpr int seconds = 8;
    int bits = 0;
    for (std::uint64_t tenth = 0; tenth < 10 * seconds; ++tenth)
      for (const CanFrame& frame : frames_due(report, tenth))
        bits += longest_bits(static_cast<int>(frame.payload.size()));
    const double load = bits / bits_per_s / seconds;
    RecordProperty("load_of_" + std::to_string(cameras), std::to_string(load));
    std::printf("%zu cameras: %.2f %% of 250 kbit/s at most\n", cameras, 100 * load);
    EXPECT_LT(load, 0.02) << cameras;
  }
  EXPECT_EQ(longest_bits(8), 135) << "the figure of the literature (Davis et al. 2007)";
}

TEST(CanReport, IsToldAtItsRates) {
  const CanReport report = report_of(8);
  std::map<int, int> count;
  for (std::uint64_t tenth = 0; tenth < 160; ++tenth)  // 16 s: ten rounds of eight cameras
    for (const CanFrame& frame : frames_due(report, tenth)) ++count[frame.offset];
  EXPECT_EQ(count[can_status], 160);
  for (const int offset : {can_health, can_heartbeat, can_result}) EXPECT_EQ(count[offset], 16);
  for (int offset = can_camera; offset < can_ids_a_unit; ++offset) EXPECT_EQ(count[offset], 10);
  EXPECT_EQ(count.size(), 28u);
  for (std::uint64_t tenth = 0; tenth < 10; ++tenth)
    EXPECT_LE(frames_due(report, tenth).size(), 4u) << "a burst";
}

TEST(CanReport, IsTheStatusDocument) {
  const Json status = Json::parse(R"({"state": "solving", "session": 3, "throws": 4,
      "worst_sigma_position_m": 0.0012, "worst_sigma_rotation_rad": null, "verdict": "accepted",
      "cameras": [{"running": true, "frames_lost_by_driver": 2, "frames_damaged": 1,
                   "frames_dropped": 4}, {"running": false, "frames_dropped": 1},
                  {"running": false, "error": "is not plugged in"}],
      "calibration_problem": null, "fault": "the disk is full", "uptime_s": 12.9,
      "software": "throwcal 1.22.3"})");
  const CanStatus now = can_status_of(status);
  EXPECT_EQ(can_state_word(now.state), "solving");
  EXPECT_EQ(can_verdict_word(now.verdict), "accepted");
  EXPECT_EQ(now.throws, 4);
  EXPECT_EQ(now.worst_sigma_position_m, 0.0012);
  EXPECT_FALSE(now.worst_sigma_rotation_rad);
  EXPECT_TRUE(now.fault);
  EXPECT_FALSE(now.calibration_problem);
  const CanHealth health = can_health_of(status);
  EXPECT_EQ(health.cameras, 3);
  EXPECT_EQ(health.cameras_running, 1);
  EXPECT_EQ(health.frames_lost, 3);
  EXPECT_EQ(health.frames_dropped, 5);
  const CanHeartbeat beat = can_heartbeat_of(status);
  EXPECT_EQ(beat.uptime_s, 12u);
  EXPECT_EQ(beat.major, 1);
  EXPECT_EQ(beat.minor, 22);
  EXPECT_EQ(beat.patch, 3);
}

TEST(CanReport, KnowsNothingOfAnEmptyDocument) {
  for (const Json& nothing : {Json(), Json::object(), Json::array({1}), Json{{"cameras", 7}}}) {
    EXPECT_EQ(can_status_of(nothing).state, can_unknown);
    EXPECT_EQ(can_health_of(nothing).cameras, 0);
    EXPECT_EQ(can_heartbeat_of(nothing).uptime_s, 0u);
  }
}

TEST(CanReport, TellsThePosesOfTheFirstEight) {
  Calibration calibration;
  calibration.cameras.resize(9);
  calibration.cameras[1].T_world_cam = Rigid{exp_so3({0.1, -0.2, 3.0}), {1, -2, 3}};
  calibration.cameras[1].covariance = Matrix6d(Matrix6d::Identity() * 1e-6);
  calibration.cameras[1].reprojection_rms_px = 0.2;
  calibration.cameras[1].sightings_used = 240;
  calibration.cameras[2].T_world_cam = Rigid{exp_so3({0, 0, 0}), {100, 0, 0}};
  const auto cameras = can_cameras_of(calibration, 7);
  ASSERT_EQ(cameras.size(), 8u);
  EXPECT_FALSE(cameras[0].quality.valid || cameras[0].position.translation_m[0]);
  EXPECT_FALSE(cameras[0].quality.reprojection_rms_px);
  EXPECT_TRUE(cameras[1].quality.valid);
  EXPECT_EQ(cameras[1].position.translation_m[1], -2.0);
  EXPECT_NEAR(*cameras[1].rotation.rotation_rad[2], 3.0, 1e-12);
  EXPECT_NEAR(*cameras[1].quality.sigma_position_m, std::sqrt(3e-6), 1e-12);
  EXPECT_EQ(cameras[1].quality.sequence, 7);
  EXPECT_FALSE(cameras[1].quality.clamped);
  EXPECT_TRUE(cameras[2].quality.clamped) << "100 m away";
  EXPECT_TRUE(decode<CanQuality>(encode(cameras[2].quality)).clamped);
}

}  // namespace
}  // namespace throwcal
