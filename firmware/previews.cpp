// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/previews.h"

namespace throwcal {

std::shared_ptr<const Preview> Previews::newest(CameraId camera, Clock::time_point now) {
  Shown& shown = shown_.at(camera);
  if (shown.made && now - *shown.made < period) return shown.preview;
  const FrameSightings last = rig_.last_sightings(camera);
  if (shown.preview && last.time == shown.of) return shown.preview;
  int width_px = 0;
  cv::Mat luma;
  {
    const auto frames = rig_.freeze(camera, last.time);
    if (frames.empty() || frames.front().frame().row0_mid_exposure != last.time)
      return shown.preview;
    width_px = frames.front().frame().image.width_px;
    luma = small_luma(frames.front().frame().image);
  }  // the ring has its slots back before the JPEG is made
  const double scale = static_cast<double>(luma.cols) / width_px;
  shown.preview = std::make_shared<const Preview>(make_preview(luma, scale, last.sightings));
  shown.made = now;
  shown.of = last.time;
  return shown.preview;
}

}  // namespace throwcal
