// SPDX-License-Identifier: BSD-3-Clause
#include "tests/bench/cases.h"

#include <cstdio>
#include <cstdlib>

#include "estimator/bootstrap.h"

namespace throwcal::bench {

Case four_cameras(bool free_running) {
  Case out{.name = free_running ? "free_running" : "synchronised",
           .thrown = test::make_thrown({.cameras = 4,
                                        .throws = 10,
                                        .max_offset_s = free_running ? 0.015 : 0.0,
                                        .drag_per_m = free_running ? 0.0175 : 0.0,
                                        .estimate_drag = free_running}),
           .throws = {},
           .start = {}};
  const auto& [rig, throws] = std::tie(out.thrown.rig, out.thrown.throws);
  out.throws = time_throws(rig, throws);
  FitMemory fits;
  const auto start = bootstrap(rig, out.throws, fit_all_flights(rig, throws, fits));
  if (!start) std::abort();
  out.start.rig = start->rig;
  for (const auto& ball : start->balls) out.start.balls.push_back(ball.value());
  return out;
}

test::Thrown thesis_rig(std::uint64_t seed, int throws, double sigma_px) {
  return test::make_thrown({.seed = seed,
                            .cameras = 2,
                            .throws = throws,
                            .arc_rad = std::numbers::pi,
                            .model = {.width_px = 366,
                                      .height_px = 234,
                                      .fx_px = 278,
                                      .fy_px = 298,
                                      .cx_px = 182.5,
                                      .cy_px = 116.5},
                            .sigma_px = sigma_px,
                            .frames_per_s = 30.0,
                            .duration_s = 1.0});
}

}  // namespace throwcal::bench
