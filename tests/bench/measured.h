// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace throwcal::bench {

/// A name that callgrind's --toggle-collect finds: only what runs inside is counted.
template <typename Work>
__attribute__((noinline)) void measured(Work work) {
  work();
}

}  // namespace throwcal::bench
