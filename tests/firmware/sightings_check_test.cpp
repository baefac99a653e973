// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/sightings_check.h"

#include <gtest/gtest.h>

#include "firmware/input_error.h"

namespace throwcal {
namespace {

RigDescription two_cameras() {
  RigDescription rig;
  rig.cameras.resize(2);
  rig.cameras[0].name = "north";
  rig.cameras[1].name = "east";
  return rig;
}

/// So many frames of a camera, 0.1 s apart.
void add(std::vector<SightingRow>& rows, CameraId camera, const ThrowId& label, int count) {
  for (int i = 0; i < count; ++i) {
    SightingRow row;
    row.sighting.camera = camera;
    row.sighting.time = HostTime(std::chrono::milliseconds(100 * i));
    row.throw_id = label;
    rows.push_back(row);
  }
}

std::string error_of(const std::vector<SightingRow>& rows) {
  try {
    check_usable(rows, two_cameras(), "s.csv");
  } catch (const InputError& error) {
    return error.what();
  }
  return "no error";
}

TEST(SightingsCheck, WantsTwoCameras) {
  std::vector<SightingRow> rows;
  add(rows, 1, "a", 20);
  add(rows, 1, "", 20);
  EXPECT_EQ(error_of(rows),
            "s.csv: all sightings are of camera \"east\"; expected those of two cameras or more");
  add(rows, 0, "", 1);
  EXPECT_EQ(error_of(rows), "no error");
}

TEST(SightingsCheck, WantsAThrowThatOneCameraCanTell) {
  std::vector<SightingRow> rows;
  for (const char* label : {"a", "b"}) add(rows, 0, label, 3), add(rows, 1, label, 4);
  EXPECT_EQ(
      error_of(rows),
      "s.csv: the longest throw, \"a\", has only 4 sightings by one camera, \"east\"; expected "
      "5 or more, as one camera alone must fix a flight");
  std::vector<SightingRow> more = rows;
  add(more, 0, "c", 5);
  EXPECT_EQ(error_of(more), "no error");
  add(rows, 0, "", 1);  // what has no label is still to be searched
  EXPECT_EQ(error_of(rows), "no error");
}

TEST(SightingsCheck, WantsThrowsNoLongerThanAFlight) {
  std::vector<SightingRow> rows;
  add(rows, 0, "a", 201);
  add(rows, 1, "b", 5);
  EXPECT_EQ(error_of(rows), "no error");
  rows.back().throw_id = "a";
  rows.back().sighting.time = HostTime(std::chrono::milliseconds(20'500));
  EXPECT_EQ(error_of(rows), "s.csv: throw \"a\" lasts 21 s; expected one flight, 20 s at most");
}

}  // namespace
}  // namespace throwcal
