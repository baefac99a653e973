// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/sightings_file.h"

#include <gtest/gtest.h>

#include "firmware/decimal_time.h"
#include "firmware/input_error.h"

namespace throwcal {
namespace {

RigDescription two_cameras() {
  RigDescription rig;
  rig.cameras.resize(2);
  rig.cameras[0].name = "north";
  rig.cameras[1].name = "east";
  rig.cameras[1].sigma_px = 0.5;
  for (CameraDescription& camera : rig.cameras)
    camera.model.width_px = 640, camera.model.height_px = 480;
  return rig;
}

std::vector<SightingRow> parsed(const std::string& csv) {
  return parse_sightings(csv, "s.csv", two_cameras());
}

std::string error_of(const std::string& csv) {
  try {
    parsed(csv);
  } catch (const InputError& error) {
    return error.what();
  }
  return "no error";
}

HostTime at_ns(std::int64_t count) { return HostTime(HostClock::duration(count)); }

TEST(SightingsFile, ColumnsStandInAnyOrderAndMayBeMore) {
  const auto rows = parsed(
      "v_px,throw,colour,camera,u_px,time_s,radius_px\r\n2.5,a,red,east,1.5,0.25,3\r\n"
      "4,,blue,north,3,0.5,\r\n");
  ASSERT_EQ(rows.size(), 2u);
  EXPECT_EQ(rows[0].sighting.camera, 1u);
  EXPECT_EQ(rows[0].sighting.center_px, Eigen::Vector2d(1.5, 2.5));
  EXPECT_EQ(rows[0].sighting.time, at_ns(250'000'000));
  EXPECT_EQ(rows[0].sighting.radius_px, 3.0);
  EXPECT_EQ(rows[0].throw_id, "a");
  EXPECT_EQ(rows[1].throw_id, "");
  EXPECT_FALSE(rows[1].sighting.radius_px);
  EXPECT_EQ(rows[1].sighting.id, 2u);
}

TEST(SightingsFile, CovarianceIsTheRigsSigmaOrAWideOne) {
  const auto rows = parsed("camera,time_s,u_px,v_px\neast,0,1,1\nnorth,0,1,1");
  EXPECT_EQ(rows[0].sighting.cov_px2(0, 0), 0.25);
  EXPECT_EQ(rows[1].sighting.cov_px2(1, 1), 1.0);
  EXPECT_EQ(rows[1].sighting.cov_px2(0, 1), 0.0);
}

TEST(SightingsFile, ASightingsOwnErrorsComeBeforeTheRigs) {
  const auto rows = parsed(
      "camera,time_s,u_px,v_px,sigma_u_px,sigma_v_px,correlation_uv,partial\n"
      "east,0,1,1,0.1,0.2,0.5,1\neast,1,1,1,,,,\n");
  EXPECT_DOUBLE_EQ(rows[0].sighting.cov_px2(0, 0), 0.01);
  EXPECT_DOUBLE_EQ(rows[0].sighting.cov_px2(1, 1), 0.04);
  EXPECT_DOUBLE_EQ(rows[0].sighting.cov_px2(0, 1), 0.01);
  EXPECT_TRUE(rows[0].sighting.is_partial);
  EXPECT_EQ(rows[1].sighting.cov_px2(0, 0), 0.25);
  EXPECT_FALSE(rows[1].sighting.is_partial);
  const auto again = parsed(to_sightings_csv(rows, two_cameras(), true));
  ASSERT_EQ(again.size(), 2u);
  EXPECT_TRUE(again[0].sighting.cov_px2.isApprox(rows[0].sighting.cov_px2, 1e-9));
  EXPECT_TRUE(again[0].sighting.is_partial);
}

TEST(SightingsFile, EveryErrorNamesFileLineColumnAndExpectation) {
  const std::string header = "camera,time_s,u_px,v_px,throw\n";
  const struct {
    std::string csv, message;
  } cases[] = {
      {"", "s.csv: is empty; expected at least a header and one row: camera,time_s,u_px,v_px"},
      {header,
       "s.csv: holds no sighting; expected at least a header and one row: camera,time_s,u_px,v_px"},
      {"camera,time_s,u_px\n",
       "s.csv:1: column v_px is missing; expected the header "
       "camera,time_s,u_px,v_px[,radius_px][,throw]"},
      {"camera,time_s,u_px,v_px,sigma_u_px\n",
       "s.csv:1: of the columns sigma_u_px and sigma_v_px one is missing; expected both or "
       "neither"},
      {"camera,time_s,u_px,v_px,sigma_u_px,sigma_v_px\nnorth,0,1,1,0,1\n",
       "s.csv:2: sigma_u_px must be a number of pixels from 1e-06 to 100, got \"0\""},
      {"camera,time_s,u_px,v_px,correlation_uv\nnorth,0,1,1,1\n",
       "s.csv:2: correlation_uv must be a number from -0.999 to 0.999, got \"1\""},
      {"camera,time_s,u_px,v_px,partial\nnorth,0,1,1,yes\n",
       "s.csv:2: partial must be a number from 0 to 1, got \"yes\""},
      {"camera,time_s,u_px,v_px,u_px\n", "s.csv:1: column u_px stands twice; expected it once"},
      {header + "\nsouth,0,1,1,\n",
       "s.csv:3: camera \"south\" is not in the rig file; expected one of north, east"},
      {header + "north,0,1\n", "s.csv:2: expected 5 columns as in the header, got 3"},
      {header + "north,now,1,1,\n",
       "s.csv:2: time_s must be a number of seconds from -4e+09 to 4e+09, got \"now\""},
      {header + "north,1e300,1,1,\n",
       "s.csv:2: time_s must be a number of seconds from -4e+09 to 4e+09, got \"1e300\""},
      {header + "north,0,nan,1,\n",
       "s.csv:2: u_px must be a number of pixels from -1e+05 to 1e+05, got \"nan\""},
      {header + "north,0,1,1e999,\n",
       "s.csv:2: v_px must be a number of pixels from -1e+05 to 1e+05, got \"1e999\""},
      {header + "north,0,1,0x10,\n",
       "s.csv:2: v_px must be a number of pixels from -1e+05 to 1e+05, got \"0x10\""},
      {header + "north,0,\"1,5\",1,\n",
       "s.csv:2: u_px must be a number of pixels from -1e+05 to 1e+05, got \"1,5\""},
      {"camera,time_s,u_px,v_px,radius_px\nnorth,0,1,1,0\n",
       "s.csv:2: radius_px must be a number of pixels from 0.01 to 1120, got \"0\""},
      {header + "north,0,1,1,a\neast,0,1,1,a\nnorth,0.0,2,2,a\n",
       "s.csv:4: camera \"north\" sees throw \"a\" at this time in line 2 already; expected one "
       "row a "
       "frame"},
      {header + "north,4000000001,1,1,\n",
       "s.csv:2: time_s must be a number of seconds from -4e+09 to 4e+09, got \"4000000001\""},
      {header + "north,0,+-1,1,\n",
       "s.csv:2: u_px must be a number of pixels from -1e+05 to 1e+05, got \"+-1\""},
      {header + "north,0,1,100001,\n",
       "s.csv:2: v_px must be a number of pixels from -1e+05 to 1e+05, got \"100001\""},
      {header + std::string("no\0th,0,1,1,\n", 13),
       "s.csv:2: camera \"no\\x00th\" is not in the rig file; expected one of north, east"},
  };
  for (const auto& [csv, message] : cases) EXPECT_EQ(error_of(csv), message);
}

TEST(SightingsFile, LabelledRowsBecomeThrowsWithATrackACameraSortedByTime) {
  const auto throws = labelled_throws(
      parsed("camera,time_s,u_px,v_px,throw\neast,0.2,1,1,b\nnorth,0.3,1,1,a\nnorth,0.1,1,1,a\n"
             "east,0.1,1,1,a\nnorth,9,1,1,\n"));
  ASSERT_EQ(throws.size(), 2u);
  EXPECT_EQ(throws[0].id, "a");
  EXPECT_EQ(throws[1].id, "b");
  ASSERT_EQ(throws[0].tracks.size(), 2u);
  EXPECT_EQ(throws[0].tracks[0].camera, 0u);
  ASSERT_EQ(throws[0].tracks[0].sightings.size(), 2u);
  EXPECT_EQ(throws[0].tracks[0].sightings[0].id, 3u);
  EXPECT_EQ(throws[0].tracks[0].sightings[1].id, 2u);
}

TEST(SightingsFile, UnlabelledRowsOfOneCameraAndTimeAreOneFrame) {
  const auto frames =
      unlabelled_frames(parsed("camera,time_s,u_px,v_px,throw\neast,0.2,1,1,\nnorth,0.1,1,1,\neast,"
                               "0.2,0.5,5,\nnorth,0,1,1,a\n"));
  ASSERT_EQ(frames.size(), 2u);
  EXPECT_EQ(frames[0].camera, 0u);
  EXPECT_EQ(frames[1].camera, 1u);
  ASSERT_EQ(frames[1].sightings.size(), 2u);
  EXPECT_EQ(frames[1].sightings[0].id, 3u);  // in an order that is not the file's
}

TEST(SightingsFile, WhatIsWrittenIsReadBack) {
  const std::string csv =
      "camera,time_s,u_px,v_px,radius_px,throw\nnorth,1767225600.123456789,1.25000,2.50000,3.500,"
      "\"a,"
      "b\"\neast,-0.000000001,-1.00000,0.00001,,\n";
  const auto rows = parsed(csv);
  EXPECT_EQ(to_sightings_csv(rows, two_cameras()), csv);
  EXPECT_EQ(rows[0].throw_id, "a,b");
}

TEST(ResidualsFile, ListsEverySightingReadAlsoThoseOfNoThrow) {
  const auto rows = parsed("camera,time_s,u_px,v_px\nnorth,0,1,2\neast,1,3,4\n");
  Calibration calibration;
  calibration.cameras.resize(2);
  calibration.cameras[0].name = "north";
  calibration.cameras[1].name = "east";
  calibration.residuals.push_back({2, "7", true, {0.5, -0.25}});
  EXPECT_EQ(to_residuals_csv({rows[0].sighting, rows[1].sighting}, calibration),
            "camera,time_s,u_px,v_px,throw,used,residual_u_px,residual_v_px\n"
            "north,0.000000000,1.00000,2.00000,,0,,\n"
            "east,1.000000000,3.00000,4.00000,7,1,0.50000,-0.25000\n");
}

TEST(DecimalTime, KeepsEveryNanosecond) {
  const struct {
    const char* text;
    std::int64_t nanoseconds;
  } cases[] = {{"0", 0},
               {"-0.0", 0},
               {"1", 1'000'000'000},
               {"+1.5", 1'500'000'000},
               {"0.000000001", 1},
               {"0.0000000005", 1},
               {"0.00000000049", 0},
               {"-0.0000000006", -1},
               {"1e-3", 1'000'000},
               {"12.5E+1", 125'000'000'000},
               {".25", 250'000'000},
               {"1767225600.123456789", 1'767'225'600'123'456'789},
               {"-9223372036.854775807", -9'223'372'036'854'775'807},
               {"00012.000", 12'000'000'000},
               {"1e-400", 0}};
  for (const auto& [text, nanoseconds] : cases) {
    const auto time = parse_time(text);
    ASSERT_TRUE(time) << text;
    EXPECT_EQ(time->time_since_epoch().count(), nanoseconds) << text;
  }
  for (const char* bad : {"", "-", ".", "1.2.3", "nan", "inf", "1e", "1e5x", "0x1", "1 2",
                          "1e1000000", "9223372036.854775808", "99999999999"})
    EXPECT_FALSE(parse_time(bad)) << bad;
}

}  // namespace
}  // namespace throwcal
