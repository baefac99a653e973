// SPDX-License-Identifier: BSD-3-Clause
// What the rig asks for in libcamera's words, on cameras that libcamera's virtual pipeline has not:
// prints what each is told.
#include <libcamera/control_ids.h>

#include <cstdio>

#include "capture/libcamera_stream.h"

namespace {

using throwcal::LibcameraControls;
namespace controls = libcamera::controls;

void print(const char* name, const libcamera::ControlInfoMap& has,
           const LibcameraControls& wanted) {
  const libcamera::ControlList told = throwcal::control_list(has, wanted);
  std::printf("%s:", name);
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
  print("nothing asked", all, {});
  print("rate", all, {.frames_per_s = 30, .exposure_s = {}, .gain = {}});
  print("rate beyond", all, {.frames_per_s = 1000, .exposure_s = {}, .gain = {}});
  print("exposure", all, {.frames_per_s = 0, .exposure_s = 0.002, .gain = {}});
  print("gain", all, {.frames_per_s = 0, .exposure_s = {}, .gain = 4});
  print("both beyond", all, {.frames_per_s = 0, .exposure_s = 1, .gain = 100});
  print("of a camera without", none, {.frames_per_s = 30, .exposure_s = 0.002, .gain = 4});
}
