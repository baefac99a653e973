// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <filesystem>
#include <functional>
#include <memory>
#include <vector>

#include "capture/camera.h"
#include "firmware/sightings_file.h"

namespace throwcal {

/// Whether a file's name ends in a form that draw_overlay() writes: ".png" or ".mkv".
bool is_overlay_name(const std::filesystem::path& file);

/// Draws what was found over what was filmed, a tile a camera: blobs thin and grey, those of a
/// flight in the flight's colour, joined. PNG: one picture, the ball of every flight in it. MKV:
/// the film itself, at the first camera's frames. `cameras` play what `rows` were found in; each
/// frame drawn is told to `drawn`. Throws InputError where it cannot be written or a camera fails.
void draw_overlay(const std::filesystem::path& file, std::vector<std::unique_ptr<Camera>> cameras,
                  const RigDescription& rig, const std::vector<SightingRow>& rows,
                  const std::function<void()>& drawn);

}  // namespace throwcal
