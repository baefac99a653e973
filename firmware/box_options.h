// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <CLI/CLI.hpp>
#include <string>

#include "firmware/box_client.h"
#include "firmware/can_client.h"

namespace throwcal {

/// Which box a command talks to, how, and as whom.
struct BoxOptions {
  std::string host = "127.0.0.1:7710", token;
  std::string can;  ///< an interface: the box is on that bus, not at the host
  int unit = 0;     ///< on the bus
  bool json = false;

  void add_to(CLI::App& command);
  void add_can_to(CLI::App& command);
  void add_token_to(CLI::App& command);

  /// Throws InputError where `host` is none or a bus is named, BoxError where no box answers there.
  BoxClient connect() const;
  CanClient listen() const { return CanClient({.interface = can, .unit = unit}); }
  /// By either way.
  BoxClient::Json latest_calibration() const;
  /// For what changes something. Without a token the box may still let us: somebody has pressed its
  /// button.
  void authenticate(BoxClient& box) const;
  std::uint32_t short_key() const;  ///< the same for CAN; 0 where there is no token

 private:
  std::string shown_token() const;
};

}  // namespace throwcal
