// SPDX-License-Identifier: BSD-3-Clause
// once CASE CONTENDER: one contender once, in a process of its own: for its peak memory and, under
// valgrind --tool=callgrind --toggle-collect=*measured*, its instructions.
#include <cstdio>
#include <cstring>
#include <string_view>

#include "estimator/calibrate.h"
#include "estimator/refinement.h"
#include "tests/bench/cases.h"
#include "tests/bench/ceres_rival.h"
#include "tests/bench/measured.h"

namespace {

using namespace throwcal;
using namespace throwcal::bench;

int run(const Case& of, std::string_view contender) {
  const RigDescription& rig = of.thrown.rig;
  if (contender == "nothing") return 0;
  if (contender == "refine") {
    measured([&] { refine(rig, of.throws, of.start); });
  } else if (contender == "calibrate") {
    measured([&] { calibrate(rig, of.thrown.throws); });
  } else if (contender == "ceres") {
    CeresRival rival(rig, of.throws, of.start);
    measured([&] { rival.solve(), rival.covariance(); });
  } else if (contender == "ceres_solve") {
    CeresRival rival(rig, of.throws, of.start);
    measured([&] { rival.solve(); });
  } else {
    std::fprintf(stderr, "once: no contender %s\n", std::string(contender).c_str());
    return 2;
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fputs("usage: once synchronised|free_running nothing|refine|calibrate|ceres|ceres_solve\n",
               stderr);
    return 2;
  }
  return run(four_cameras(std::strcmp(argv[1], "free_running") == 0), argv[2]);
}
