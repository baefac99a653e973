// SPDX-License-Identifier: BSD-3-Clause
#include "tests/support/thesis_table.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

namespace throwcal::test {
namespace {

constexpr int seeds = 20;

using Member = double ThesisErrors::*;

Member angle(const ThesisExperiment& e) {
  return e.is_drop ? &ThesisErrors::turned_angle_rad : &ThesisErrors::angle_rad;
}

Member centre(const ThesisExperiment& e) {
  return e.is_drop ? &ThesisErrors::turned_centre_m : &ThesisErrors::centre_m;
}

std::string figure(double value) {
  if (std::isnan(value)) return "?";
  char text[32];
  std::snprintf(text, sizeof text, "%.4f", value);
  return std::isfinite(value) ? text : "none";
}

struct Row {
  const char* error;
  std::string thesis, filter, full, least_squares = "-", cramer_rao = "-";
};

void print(const ThesisExperiment& e, const Row& row) {
  std::printf("| %s | %s | %s | %s | %s | %s | %s |\n", e.name.c_str(), row.error,
              row.thesis.c_str(), row.filter.c_str(), row.full.c_str(), row.least_squares.c_str(),
              row.cramer_rao.c_str());
}

void print(const ThesisComparison& c) {
  const ThesisExperiment& e = c.experiment;
  const bool thesis_is_truth = c.thesis.centre_m == 0.0;
  const auto full = [&](double error) {
    return e.is_drop
               ? "refused " + std::to_string(c.full.unobservable) + "/" + std::to_string(seeds)
               : figure(error);
  };
  const auto pose = [&](const char* error, Member m) {
    print(e, {error, thesis_is_truth ? "-" : figure(c.thesis.*m), figure(c.filter.*m),
              full(c.full.errors.*m), figure(c.bounds.least_squares.*m),
              figure(c.bounds.cramer_rao.*m)});
  };
  if (!e.is_parallel)
    pose("z-x-z rad", &ThesisErrors::zxz_rad);
  else if (!thesis_is_truth)
    print(e, {"z-x-z rad", figure(c.thesis.zxz_rad), "-", "-"});
  pose("angle rad", &ThesisErrors::angle_rad);
  pose("centre m", &ThesisErrors::centre_m);
  if (e.is_drop) pose("turned angle rad", angle(e)), pose("turned centre m", centre(e));
  for (std::size_t k = 0; k < 2; ++k)
    print(e, {k == 0 ? "Cam1 px" : "Cam2 px", figure(c.thesis.reprojection_px[k]),
              figure(c.filter.reprojection_px[k]), full(c.full.errors.reprojection_px[k]), "-",
              figure(c.noise_px[k])});
}

/// Calls check(errors, method's name) for both methods, of a drop for the filter alone.
template <typename Check>
void for_each_method(const ThesisComparison& c, Check check) {
  check(c.filter, "filter");
  if (!c.experiment.is_drop) check(c.full.errors, "full");
}

}  // namespace

ThesisComparison compare(const ThesisExperiment& experiment, const ThesisFilter& filter,
                         const ThesisResult& thesis) {
  ThesisComparison c{experiment,
                     errors_of(experiment, thesis),
                     filter_errors(experiment, filter, seeds),
                     full_errors(experiment, seeds),
                     bounds_of(experiment),
                     truth_errors(experiment, seeds).reprojection_px};
  print(c);
  return c;
}

void expect_poses_not_above_thesis(const ThesisComparison& c) {
  for_each_method(c, [&](const ThesisErrors& ours, const char* method) {
    for (const Member m : {angle(c.experiment), centre(c.experiment)})
      EXPECT_LE(ours.*m, c.thesis.*m) << method;
  });
}

void expect_reprojection_not_above_thesis(const ThesisComparison& c) {
  for_each_method(c, [&](const ThesisErrors& ours, const char* method) {
    for (std::size_t k = 0; k < 2; ++k)
      EXPECT_LE(ours.reprojection_px[k], std::fmax(c.thesis.reprojection_px[k], c.noise_px[k]))
          << method;
  });
}

void expect_least_squares(const ThesisComparison& c) {
  for_each_method(c, [&](const ThesisErrors& ours, const char* method) {
    for (const Member m : {angle(c.experiment), centre(c.experiment)})
      EXPECT_LE(ours.*m, 1.4 * c.bounds.least_squares.*m) << method;
  });
}

}  // namespace throwcal::test
