// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <optional>
#include <string>
#include <string_view>

namespace throwcal {

/// Where a service listens.
struct ListenAddress {
  std::string host = "0.0.0.0";
  int port = 7710;  ///< 0: any free one
};

/// "HOST", "HOST:PORT" or "[V6]:PORT"; nothing where it is none of these.
std::optional<ListenAddress> parse_address(std::string_view text, int default_port);

/// What parse_address() reads back.
std::string to_text(const ListenAddress& address);

}  // namespace throwcal
