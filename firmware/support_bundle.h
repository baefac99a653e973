// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <functional>
#include <string>

#include "firmware/config.h"
#include "firmware/json_rpc.h"

namespace throwcal {

/// What a person asks for who shall help from afar, as one .tar of at most 10 MB: the documents of
/// the box, its configuration without secrets, its last log lines. Made in memory.
std::string support_bundle(JsonRpc& rpc, const Config& config, const std::string& metrics);

}  // namespace throwcal
