// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <filesystem>
#include <functional>

#include "capture/camera.h"

namespace throwcal {

/// Films a camera until it ends: FILE (lossless FFV1 in Matroska) and, beside it,
/// FILE's stem + ".timestamps.txt" (timestamp format v2, milliseconds: the middle of row 0's
/// exposure). `filmed` is told each frame's time. Throws InputError where it can't be written or
/// the camera fails. Grey and bgr pictures only.
void record_video(Camera& camera, const std::filesystem::path& file,
                  const std::function<void(HostTime)>& filmed);

}  // namespace throwcal
