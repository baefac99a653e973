// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <optional>

#include "firmware/listen_address.h"

namespace throwcal {

/// The rig file's table [http].
struct HttpSettings {
  std::optional<ListenAddress> listen = ListenAddress{"0.0.0.0", 8080};  ///< nothing: no HTTP
};

}  // namespace throwcal
