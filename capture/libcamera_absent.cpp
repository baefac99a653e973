// SPDX-License-Identifier: BSD-3-Clause
// Compiled in place of libcamera_*.cpp where there is no libcamera 0.4 or newer.
#include <stdexcept>

#include "capture/libcamera.h"

namespace throwcal {

std::unique_ptr<Camera> make_libcamera_camera(const CameraSource& source, const std::string&) {
  throw std::runtime_error("camera " + source.name + ": source \"" + source.source +
                           "\" needs a throwcal that was built with libcamera 0.4 or newer (the "
                           "package libcamera-dev of Debian 13); this one was built without");
}

std::vector<LibcameraListing> list_libcamera_cameras() { return {}; }

}  // namespace throwcal
