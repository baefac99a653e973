// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <string>
#include <string_view>

namespace throwcal {

/// Text from outside, fit for a one-line message: what is not printable ASCII becomes \xNN, what is
/// longer than `enough` characters ends in "...".
std::string printable(std::string_view text, std::size_t enough = 40);

/// The same between quotes.
std::string in_quotes(std::string_view text);

/// As a person writes it: at most six digits.
std::string number_text(double number);

}  // namespace throwcal
