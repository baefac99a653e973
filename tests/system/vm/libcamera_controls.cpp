// SPDX-License-Identifier: BSD-3-Clause
// What the rig asks for in libcamera's words, on cameras that libcamera's virtual pipeline has not:
// prints what each is told.
#include <libcamera/control_ids.h>

#include <cstdio>

#include "capture/libcamera_stream.h"

namespace {

using throwcal::DeviceWishes;
namespace controls = libcamera::controls;

void print(const char* name, const libcamera::ControlInfoMap& has, const DeviceWishes& wanted) {
  std::printf("%s:", name);
  libcamera::ControlList told;
  try {
    told = throwcal::control_list(has, wanted);
  } catch (const std::runtime_error& error) {
    std::printf(" %s\n", error.what());
    return;
  }
  if (const auto limits = told.get(controls::FrameDurationLimits))
    std::printf(" frames of %lld to %lld us", static_cast<long long>((*limits)[0]),
                static_cast<long long>((*limits)[1]));
  if (const auto automatic = told.get(controls::AeEnable))
    std::printf(" automatic %s", *automatic ? "on" : "off");
  if (const auto us = told.get(controls::ExposureTime)) std::printf(" exposure %d us", *us);
  if (const auto gain = told.get(controls::AnalogueGain)) std::printf(" gain %g", double{*gain});
  std::printf("\n");
}

}  // namespace

int main() {
  const libcamera::ControlInfoMap all(
      {{&controls::FrameDurationLimits,
        libcamera::ControlInfo(std::int64_t{16667}, std::int64_t{100000})},
       {&controls::AeEnable, libcamera::ControlInfo(false, true)},
       {&controls::ExposureTime, libcamera::ControlInfo(100, 50000)},
       {&controls::AnalogueGain, libcamera::ControlInfo(1.0f, 16.0f)}},
      controls::controls);
  const libcamera::ControlInfoMap none({}, controls::controls);
  DeviceWishes wishes;
  print("nothing asked", all, wishes);
  wishes.picture.automatic = true;
  print("automatic", all, wishes);
  wishes.picture.automatic = false;
  wishes.frames_per_s = 30;
  print("rate", all, wishes);
  wishes.frames_per_s = 1000;
  print("rate beyond", all, wishes);
  wishes.picture.exposure_s = 0.002;
  wishes.picture.gain = 4;
  print("exposure and gain", all, wishes);
  print("of a camera without", none, wishes);
  wishes.picture.gain = 100;
  print("gain beyond", all, wishes);
}
