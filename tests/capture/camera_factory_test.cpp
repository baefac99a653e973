// SPDX-License-Identifier: BSD-3-Clause
#include "capture/camera_factory.h"

#include <gtest/gtest.h>

#include "capture/libcamera.h"

namespace throwcal {
namespace {

#ifndef THROWCAL_LIBCAMERA
std::string error_of(const std::string& what) {
  CameraSource source;
  source.name = "north";
  source.source = what;
  try {
    make_camera(source);
  } catch (const std::runtime_error& e) {
    return e.what();
  }
  return "none";
}

TEST(CameraFactory, SaysThatItWasBuiltWithoutLibcamera) {
  EXPECT_EQ(error_of("libcamera:0"),
            "camera north: source \"libcamera:0\" needs a throwcal that was built with libcamera "
            "0.4 or newer (the package libcamera-dev of Debian 13); this one was built without");
  EXPECT_TRUE(list_libcamera_cameras().empty());
}
#endif

}  // namespace
}  // namespace throwcal
