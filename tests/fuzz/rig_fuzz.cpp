// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/config.h"
#include "tests/fuzz/outside_text.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace throwcal;
  Config config;
  if (!is_accepted<InputError>([&] { config = parse_config(text_of(data, size), "rig.toml"); }))
    return 0;
  const std::string written = to_toml(config);
  require(to_toml(parse_config(written, "written.toml")) == written,
          "what is written is read back");
  return 0;
}
