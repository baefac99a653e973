// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "estimator/time.h"

namespace throwcal {

/// Frame times from a file in mkvtoolnix' "timestamp format v2": a line a frame, milliseconds with
/// decimals, '#' begins a comment. Exact to the nanosecond, 126 years either way. Throws
/// std::runtime_error naming file and line where a line is no time or times do not ascend.
std::vector<HostTime> read_frame_times(const std::string& path);

/// The same from text; `name` stands for the file in messages.
std::vector<HostTime> parse_frame_times(std::string_view text, const std::string& name);

}  // namespace throwcal
