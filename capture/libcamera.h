// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <memory>
#include <string>
#include <vector>

#include "capture/camera_factory.h"
#include "capture/v4l2_list.h"

// The cameras of libcamera, where this throwcal was built with it; else libcamera_absent.cpp.
namespace throwcal {

/// `which`: a camera's id, its number, or empty: the only one. Throws std::runtime_error: what was
/// asked and what there is.
std::unique_ptr<Camera> make_libcamera_camera(const CameraSource& source, const std::string& which);

/// A camera as libcamera describes it.
struct LibcameraListing {
  std::string id, model;
  std::vector<V4l2Offer> offers;  ///< it tells no rates
  std::string problem;            ///< why it cannot be used; empty: nothing is wrong
};

/// All of them, in the order of their numbers.
std::vector<LibcameraListing> list_libcamera_cameras();

}  // namespace throwcal
