// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <CLI/CLI.hpp>
#include <string>

#include "firmware/box_client.h"

namespace throwcal {

/// Which box a command talks to, and as whom.
struct BoxOptions {
  std::string host = "127.0.0.1:7710", token;
  bool json = false;

  void add_to(CLI::App& command);
  void add_token_to(CLI::App& command);

  /// Throws InputError where `host` is none, BoxError where no box answers there.
  BoxClient connect() const;
  /// For what changes something. Without a token the box may still let us: somebody has pressed its
  /// button.
  void authenticate(BoxClient& box) const;
};

}  // namespace throwcal
