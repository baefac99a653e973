// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "estimator/calibrate.h"
#include "estimator/calibration.h"

namespace throwcal {

using Json = nlohmann::ordered_json;

/// "throwcal 0.1.0"
std::string software_name();

/// "2026-01-31T12:00:00Z" of now.
std::string utc_now();

/// The calibration file (schema throwcal/calibration/1): what is not known is null, never NaN.
Json to_json(const Calibration& calibration, const std::string& created_utc);

/// {"translation_m": [x, y, z], "quaternion_wxyz": [w, x, y, z]} with w >= 0; null where unknown.
Json pose_to_json(const std::optional<Rigid>& T);

/// A calibration file's start for another calibration of the same cameras, matched by name. Throws
/// InputError: `guess.json: camera "north" has no T_world_cam; ...`.
Guess to_guess(const Json& document, const RigDescription& rig, const std::string& name);

/// A calibration document as values, all but the residuals, which it doesn't hold. Throws
/// InputError where it isn't one.
Calibration to_calibration(const Json& document, const std::string& name);

/// Any JSON file. Throws InputError with path and line.
Json read_json(const std::filesystem::path& file);
/// The same from text; `name` stands for the file in messages.
Json parse_json(std::string_view text, const std::string& name);

std::string to_string(Verdict verdict);  ///< "accepted", "needs-more-throws", ...
std::string to_string(Method method);    ///< "full", "rb-ekf", "r-ekf", "ekf"
std::optional<Method> parse_method(std::string_view text);

}  // namespace throwcal
