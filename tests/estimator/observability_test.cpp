// SPDX-License-Identifier: BSD-3-Clause
#include "estimator/observability.h"

#include "estimator/calibrate.h"
#include "tests/support/true_solution.h"

namespace throwcal {
namespace {

using test::make_thrown;
using test::Thrown;

std::string reasons_of(const Calibration& at) {
  std::string out;
  for (const std::string& reason : at.reasons) out += reason + "\n";
  return out;
}

TEST(Observability, DropsOnOneSpotLeaveTheHeadingsOpenHoweverMany) {
  for (int throws : {1, 3, 6, 20})
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      const Thrown thrown =
          make_thrown({.seed = seed, .throws = throws, .duration_s = 0.6, .vertical_drops = true});
      const Calibration at = calibrate(thrown.rig, thrown.throws);
      EXPECT_EQ(at.verdict, Verdict::unobservable) << throws << " drops, seed " << seed;
      EXPECT_NE(reasons_of(at).find("all fell straight down: the heading between cam1 and "),
                std::string::npos)
          << reasons_of(at);
    }
}

TEST(Observability, OneThrowAcrossAmongDropsIsEnough) {
  Thrown thrown = make_thrown({.throws = 4, .duration_s = 0.6, .vertical_drops = true});
  const Thrown across = make_thrown({.throws = 2});
  thrown.throws[0] = across.throws[0];
  thrown.rig.target = {0.05, 0.02};
  const Calibration at = calibrate(thrown.rig, thrown.throws);
  EXPECT_EQ(at.verdict, Verdict::accepted) << reasons_of(at);
}

TEST(Observability, ACameraThatSharesNoThrowIsToldSo) {
  Thrown thrown = make_thrown({});
  for (Throw& t : thrown.throws)
    std::erase_if(t.tracks, [](const Track& track) { return track.camera == 3; });
  const Calibration at = calibrate(thrown.rig, thrown.throws);
  EXPECT_NE(reasons_of(at).find("camera cam4 cannot be placed: it shares no throw with the others"),
            std::string::npos)
      << reasons_of(at);
}

TEST(Observability, ALensNumberThatNothingShowsIsNamed) {
  // The row time of a camera whose sightings all lie in its first row moves nothing.
  Thrown thrown = make_thrown({.throws = 4});
  thrown.rig.cameras[1].estimate = {Intrinsic::row_time};
  for (Throw& t : thrown.throws)
    for (Track& track : t.tracks)
      for (BallSighting& s : track.sightings)
        if (track.camera == 1) s.center_px.y() = 0.0;
  const auto timed = time_throws(thrown.rig, thrown.throws);
  Refinement at =
      refine(thrown.rig, timed, test::true_solution(thrown, timed), {.max_iterations = 0});
  const auto said = undetermined(thrown.rig, timed, at);
  ASSERT_EQ(said.size(), 1u);
  EXPECT_NE(said[0].find("camera cam2 has a row_time_s that is not determined"), std::string::npos)
      << said[0];
}

}  // namespace
}  // namespace throwcal
