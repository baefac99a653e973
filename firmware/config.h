// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <chrono>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "capture/camera_factory.h"
#include "capture/colour.h"
#include "capture/simulated_scene.h"
#include "estimator/rig_description.h"
#include "firmware/can_settings.h"
#include "firmware/http_settings.h"
#include "firmware/listen_address.h"
#include "firmware/panel_settings.h"
#include "firmware/toml_table.h"

namespace throwcal {

/// How a camera's pictures come.
struct CameraInput {
  /// "simulated", "video:PATH", "v4l2:DEVICE", "libcamera:ID"; empty: not said
  std::string source;
  DeviceWishes device;
};

/// The rig file: what the estimator must know of the rig, and what the box must know to run it.
struct Config {
  std::string text;  ///< as it was read
  RigDescription rig;
  int target_throws = 3;  ///< that must agree before a session ends itself
  std::optional<Colour> ball_colour;
  std::vector<CameraInput> inputs;  ///< a camera each
  SimulatedSceneSettings simulation;
  ListenAddress listen;
  std::optional<CanSettings> can;  ///< absent: no CAN
  HttpSettings http;
  std::optional<std::filesystem::path> state_dir;
  std::optional<std::filesystem::path> token_file;  ///< default: `token` in the state folder
  std::string unit;                                 ///< this box's name; empty: the host's
  /// What was seen so long before the capture began belongs to it.
  std::chrono::nanoseconds pre_trigger = std::chrono::seconds(5);
  std::uint64_t keep_free_bytes =
      64'000'000;             ///< of the disk; sightings' pictures make room for it
  bool keep_evidence = true;  ///< whether these are kept at all
  std::optional<std::size_t> frame_memory_bytes;  ///< that frames may take; default: see cameras.h
  ButtonSettings button;
  LightSettings light;
  std::vector<std::string> warnings;  ///< keys that nobody reads, "rig.toml:7: ..." each
};

/// Reads a rig file (TOML). Throws InputError: "rig.toml:12: camera "north": fx_px must be a
/// positive number, got -3". Keys it does not know are warnings in the contract's tables and errors
/// in the daemon's own ([daemon], [simulation]). Relative paths are relative to the file.
Config read_config(const std::filesystem::path& file);

/// The same from text; `name` stands for the file in messages, `folder` for where relative paths
/// start.
Config parse_config(std::string_view toml, const std::string& name,
                    const std::filesystem::path& folder = {});

/// A rig file that read_config() reads back as the same configuration.
std::string to_toml(const Config& config);

/// "#d7eb5a": red, green, blue. Nothing where it is not that.
std::optional<Colour> parse_colour(std::string_view text);

}  // namespace throwcal
