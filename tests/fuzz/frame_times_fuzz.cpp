// SPDX-License-Identifier: BSD-3-Clause
#include "capture/frame_times.h"
#include "tests/fuzz/outside_text.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace throwcal;
  is_accepted<std::runtime_error>([&] {
    const auto times = parse_frame_times(text_of(data, size), "a.timestamps.txt");
    for (std::size_t i = 1; i < times.size(); ++i)
      require(times[i] - times[i - 1] > HostClock::duration::zero(), "times ascend");
  });
  return 0;
}
