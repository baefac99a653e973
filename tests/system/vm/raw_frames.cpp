// SPDX-License-Identifier: BSD-3-Clause
// raw_frames VIDEO OUTPUT: a video's frames, grey and back to back, as loopback_player plays them.
#include <cstdio>
#include <fstream>
#include <vector>

#include "capture/camera_factory.h"

int main(int argc, char** argv) {
  if (argc != 3) return 2;
  try {
    throwcal::CameraSource source;
    source.name = "video", source.source = std::string("video:") + argv[1];
    const auto camera = throwcal::make_camera(source);
    const auto format = camera->format();
    std::vector<std::uint8_t> picture(static_cast<std::size_t>(format.width_px) * format.height_px);
    std::ofstream out(argv[2], std::ios::binary);
    throwcal::Frame frame;
    while (camera->next(picture, frame) == throwcal::Camera::Outcome::frame)
      out.write(reinterpret_cast<const char*>(picture.data()),
                static_cast<std::streamsize>(picture.size()));
    return camera->error().empty() && out ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "raw_frames: %s\n", error.what());
    return 1;
  }
}
