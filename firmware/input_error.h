// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <stdexcept>

namespace throwcal {

/// What a user gave is not usable. what() is one line: place, what is wrong, what was expected.
struct InputError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

}  // namespace throwcal
