// SPDX-License-Identifier: BSD-3-Clause
// once CASE CONTENDER: one contender once, in a process of its own. Prints the memory that it adds
// at its most [MB]; under valgrind --tool=callgrind --toggle-collect=*measured* its instructions
// are counted.
#include <cstdio>
#include <cstring>
#include <string>

#include "estimator/calibrate.h"
#include "estimator/refinement.h"
#include "tests/bench/cases.h"
#include "tests/bench/ceres_rival.h"
#include "tests/bench/measured.h"

namespace {

using namespace throwcal;
using namespace throwcal::bench;

bool run(const Case& of, const std::string& contender) {
  const RigDescription& rig = of.thrown.rig;
  if (contender == "refine") {
    measured([&] { refine(rig, of.throws, of.start); });
  } else if (contender == "calibrate") {
    measured([&] { calibrate(rig, of.thrown.throws); });
  } else if (contender == "ceres" || contender == "ceres_solve") {
    CeresRival rival(rig, of.throws, of.start);
    measured([&] {
      rival.solve();
      if (contender == "ceres") rival.covariance();
    });
  } else {
    return false;
  }
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 3) {
    const Case of = four_cameras(std::strcmp(argv[1], "free_running") == 0);
    forget_most_resident();
    const double before_mb = resident_mb("VmRSS:");
    if (run(of, argv[2])) {
      std::printf("%.2f\n", resident_mb("VmHWM:") - before_mb);
      return 0;
    }
  }
  std::fputs("usage: once synchronised|free_running refine|calibrate|ceres|ceres_solve\n", stderr);
  return 2;
}
