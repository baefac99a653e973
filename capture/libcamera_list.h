// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <libcamera/camera.h>
#include <libcamera/stream.h>

#include <memory>
#include <string>

#include "capture/libcamera.h"

namespace throwcal {

/// By its id or its number; empty: the only one. Throws std::runtime_error.
std::shared_ptr<libcamera::Camera> find_libcamera_camera(const std::string& which);

/// V4L2's name of a format of libcamera's, 0 where it is not read here.
std::uint32_t read_fourcc(const libcamera::PixelFormat& format);

/// "640x480, 1280x720", or "64x64 to 1920x1080".
std::string sizes_text(const libcamera::StreamFormats& formats,
                       const libcamera::PixelFormat& format);

/// For video, or else for a viewfinder; nullptr where it gives neither.
std::unique_ptr<libcamera::CameraConfiguration> video_configuration(libcamera::Camera& camera);

}  // namespace throwcal
