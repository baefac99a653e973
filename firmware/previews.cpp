// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/previews.h"

namespace throwcal {

std::shared_ptr<const Preview> Previews::newest(CameraId camera, Clock::time_point now) {
  Shown& shown = shown_.at(camera);
  if (shown.made && now - *shown.made < period) return shown.preview;
  auto lease = rig_.newest(camera);
  if (!lease) return shown.preview;
  const HostTime time = lease->frame().row0_mid_exposure;
  if (shown.preview && time == shown.of) return shown.preview;
  FrameSightings last = rig_.last_sightings(camera);
  if (last.time != time) {  // the detector is at it, or at one before it: rings would be elsewhere
    if (shown.made && now - *shown.made < patience) return shown.preview;
    last.sightings.clear();
  }
  const cv::Mat luma = small_luma(lease->frame().image);
  const double scale = static_cast<double>(luma.cols) / lease->frame().image.width_px;
  lease.reset();  // the ring has its slot back before the JPEG is made
  shown.preview = std::make_shared<const Preview>(make_preview(luma, scale, last.sightings));
  shown.made = now;
  shown.of = time;
  return shown.preview;
}

}  // namespace throwcal
