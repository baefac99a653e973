// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/camera_changes.h"

#include <gtest/gtest.h>

namespace throwcal {
namespace {

using Json = nlohmann::ordered_json;

constexpr const char* vga = "640x480 YUYV at 30/s";

CameraStats camera(const std::string& name, const CameraIdentity& identity) {
  CameraStats out;
  out.name = name;
  out.identity = identity;
  return out;
}

const CameraIdentity eye_a{"usb-1", "Eye", "A", vga}, eye_b{"usb-2", "Eye", "B", vga};

/// A calibration made with these cameras.
Json made_with(const CameraIdentity& north, const CameraIdentity& east) {
  Json document{{"cameras", {{{"name", "north"}}, {{"name", "east"}}}}};
  add_devices(document, devices_of({camera("north", north), camera("east", east)}, true));
  return document;
}

std::vector<std::string> changes(const Json& document, const CameraIdentity& north,
                                 const CameraIdentity& east) {
  return camera_changes(document,
                        devices_of({camera("north", north), camera("east", east)}, false));
}

TEST(CameraChanges, NothingSpeaksAgainstTheSameCamerasOrUnknownOnes) {
  const Json document = made_with(eye_a, eye_b);
  EXPECT_EQ(document["cameras"][1]["device"]["serial"], "B");
  EXPECT_TRUE(changes(document, eye_a, eye_b).empty());
  EXPECT_TRUE(changes(document, eye_a, {}).empty()) << "one that is not plugged in";
  const Json of_films = made_with({}, {});
  EXPECT_FALSE(of_films["cameras"][0].contains("device"));
  EXPECT_TRUE(changes(of_films, eye_a, eye_b).empty()) << "an old document";
}

TEST(CameraChanges, SwappedCablesAreNamed) {
  CameraIdentity a_at_2 = eye_a, b_at_1 = eye_b;
  std::swap(a_at_2.port, b_at_1.port);
  const auto told = changes(made_with(eye_a, eye_b), b_at_1, a_at_2);
  ASSERT_EQ(told.size(), 2u);
  EXPECT_EQ(
      told[0],
      "camera \"north\" was \"Eye\", serial A at usb-1, now it is \"Eye\", serial B at usb-1, "
      "which was \"east\": cables are swapped");
}

TEST(CameraChanges, AnotherCameraAndAnotherModeAreNamed) {
  CameraIdentity other{"usb-1", "Cam X", "C", vga}, wide = eye_b;
  wide.mode = "1280x720 YUYV at 30/s";
  const auto told = changes(made_with(eye_a, eye_b), other, wide);
  ASSERT_EQ(told.size(), 2u);
  EXPECT_EQ(
      told[0],
      "camera \"north\" was \"Eye\", serial A at usb-1, now it is \"Cam X\", serial C at usb-1");
  EXPECT_EQ(told[1], "camera \"east\" gave 640x480 YUYV at 30/s, now 1280x720 YUYV at 30/s");
}

TEST(CameraChanges, ACameraIsItselfAtAnotherPortIfItHasASerialNumber) {
  CameraIdentity moved = eye_a, plain = eye_b, plain_moved = eye_b;
  moved.port = plain_moved.port = "usb-7";
  plain.serial = plain_moved.serial = "";
  EXPECT_TRUE(changes(made_with(eye_a, eye_b), moved, eye_b).empty());
  EXPECT_EQ(changes(made_with(eye_a, plain), eye_a, plain_moved).size(), 1u);
}

TEST(CameraChanges, TwinsWithOneSerialNumberAreKnownByTheirPorts) {
  CameraIdentity one{"usb-1", "Eye", "SN0001", vga}, other{"usb-2", "Eye", "SN0001", vga};
  EXPECT_TRUE(changes(made_with(one, other), one, other).empty());
  CameraIdentity one_at_2 = one, other_at_1 = other;
  std::swap(one_at_2.port, other_at_1.port);
  EXPECT_EQ(changes(made_with(one, other), one_at_2, other_at_1).size(), 2u);
}

TEST(CameraChanges, AnotherRateIsTheSamePicture) {
  CameraIdentity slow = eye_a;
  slow.mode = "640x480 MJPG at 15/s";
  EXPECT_TRUE(changes(made_with(eye_a, eye_b), slow, eye_b).empty());
}

TEST(CameraChanges, AStrangerAtAPortIsNotTheSessionsCamera) {
  CameraStats north = camera("north", eye_b);
  north.error = "here is another camera";
  EXPECT_TRUE(devices_of({north}, true).empty());
  EXPECT_EQ(devices_of({north}, false)["north"]["serial"], "B");
}

}  // namespace
}  // namespace throwcal
