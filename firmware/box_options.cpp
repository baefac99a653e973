// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/box_options.h"

#include <unistd.h>

#include <cstdlib>

#include "firmware/access.h"
#include "firmware/export.h"
#include "firmware/input_error.h"

namespace throwcal {
namespace {

/// Where the token of a box on this machine is.
constexpr const char* own_token_file = "/var/lib/throwcal/token";
constexpr const char* token_variable = "THROWCAL_TOKEN";

}  // namespace

void BoxOptions::add_to(CLI::App& command) {
  command.add_option("--host", host, "The box: HOST or HOST:PORT")->capture_default_str();
  command.add_flag("--json", json, "Print JSON for scripts");
}

void BoxOptions::add_can_to(CLI::App& command) {
  command.add_option("--can", can, "The box is on this CAN bus: can0");
  command.add_option("--unit", unit, "Which box on the bus ([can] unit of its rig file)")
      ->check(CLI::Range(0, can_units - 1));
}

void BoxOptions::add_token_to(CLI::App& command) {
  command.add_option("--token", token,
                     std::string("What the box's file `token` holds; default: $") + token_variable +
                         ", then " + own_token_file + ", where it is readable");
}

BoxClient BoxOptions::connect() const {
  if (!can.empty()) throw InputError("--can: this goes by TCP only (--host)");
  const auto address = parse_address(host, 7710);
  if (!address) throw InputError("--host " + host + ": expected HOST or HOST:PORT");
  return BoxClient(*address);
}

BoxClient::Json BoxOptions::latest_calibration() const {
  if (can.empty()) return connect().call("calibration.latest");
  return parse_json(listen().document(), "the box's calibration");
}

std::string BoxOptions::shown_token() const {
  if (!token.empty()) return token;
  // Not CLI11's envname(): it fills the option of the other commands, too, which is the same text.
  if (const char* given = std::getenv(token_variable); given && *given) return given;
  return access(own_token_file, R_OK) == 0 ? token_in(own_token_file) : "";
}

void BoxOptions::authenticate(BoxClient& box) const {
  if (const std::string shown = shown_token(); !shown.empty()) box.call("auth", {{"token", shown}});
}

std::uint32_t BoxOptions::short_key() const {
  const std::string shown = shown_token();
  return shown.empty() ? 0 : Access(shown).short_key();
}

}  // namespace throwcal
