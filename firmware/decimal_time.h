// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <optional>
#include <string>
#include <string_view>

#include "estimator/time.h"

namespace throwcal {

/// Decimal seconds to the nearest nanosecond, exactly; nothing where it isn't a number or doesn't
/// fit (292 years). By way of a double, a time since 1970 would lose 100 ns.
std::optional<HostTime> parse_time(std::string_view decimal_seconds);

/// The same back: "12.345678901".
std::string to_decimal_seconds(HostTime time);

}  // namespace throwcal
