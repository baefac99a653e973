// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/config.h"
#include "tests/fuzz/outside_text.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace throwcal;
  Config config;
  if (!is_accepted<InputError>([&] { config = parse_config(text_of(data, size), "rig.toml"); }))
    return 0;
  // Written twice: -0 is a whole number to TOML, and comes back as 0.
  const std::string written = to_toml(parse_config(to_toml(config), "written.toml"));
  require(to_toml(parse_config(written, "again.toml")) == written, "what is written is read back");
  return 0;
}
