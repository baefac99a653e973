// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/box_options.h"

#include <unistd.h>

#include "firmware/access.h"
#include "firmware/input_error.h"

namespace throwcal {
namespace {

/// Where the token of a box on this machine is.
constexpr const char* own_token_file = "/var/lib/throwcal/token";

}  // namespace

void BoxOptions::add_to(CLI::App& command) {
  command.add_option("--host", host, "The box: HOST or HOST:PORT")->capture_default_str();
  command.add_flag("--json", json, "Print JSON for scripts");
}

void BoxOptions::add_token_to(CLI::App& command) {
  command
      .add_option("--token", token,
                  std::string("What the box's file `token` holds; default: ") + own_token_file +
                      ", where it is readable")
      ->envname("THROWCAL_TOKEN");
}

BoxClient BoxOptions::connect() const {
  const auto address = parse_address(host, 7710);
  if (!address) throw InputError("--host " + host + ": expected HOST or HOST:PORT");
  return BoxClient(*address);
}

void BoxOptions::authenticate(BoxClient& box) const {
  std::string shown = token;
  if (shown.empty() && access(own_token_file, R_OK) == 0) shown = token_in(own_token_file);
  if (!shown.empty()) box.call("auth", {{"token", shown}});
}

}  // namespace throwcal
