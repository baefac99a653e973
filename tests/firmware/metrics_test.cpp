// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/metrics.h"

#include <gtest/gtest.h>

#include <regex>
#include <sstream>

namespace throwcal {
namespace {

using Json = nlohmann::ordered_json;

const Json status = {
    {"state", "capturing"},
    {"throws", 3},
    {"worst_sigma_position_m", 0.0025},
    {"worst_sigma_rotation_rad", nullptr},
    {"cameras",
     {{{"name", "north"}, {"running", true}, {"frames", 18446744073709551615u}, {"error", nullptr}},
      {{"name", "east"}, {"running", false}, {"frames", 0}, {"error", nullptr}}}},
    {"sightings_dropped", 0},
    {"fault", "disk \"full\""},
    {"can", {{"state", "queue-full"}, {"problem", nullptr}, {"queue_full", 7}, {"wrong_keys", 2}}},
    {"uptime_s", 1.5},
    {"software", "throwcal \"x\\\n"}};

std::string text() { return to_metrics(status, {Target{0.005, 0.002}, 2, 3}); }

bool has_line(const std::string& line) {
  return ("\n" + text()).find("\n" + line + "\n") != std::string::npos;
}

TEST(Metrics, TellWhatTheStatusTells) {
  for (const char* line :
       {"throwcal_state{state=\"capturing\"} 1", "throwcal_throws 3",
        "throwcal_worst_sigma_position_metres 0.0025", "throwcal_target_position_metres 0.005",
        "throwcal_camera_running{camera=\"north\"} 1", "throwcal_camera_running{camera=\"east\"} 0",
        "throwcal_camera_frames_total{camera=\"north\"} 18446744073709551615", "throwcal_fault 1",
        "throwcal_can_state{state=\"queue-full\"} 1", "throwcal_can_queue_full_total 7",
        "throwcal_can_wrong_keys_total 2", "throwcal_tcp_clients 2", "throwcal_http_connections 3",
        "throwcal_info{software=\"throwcal \\\"x\\\\\\n\"} 1", "throwcal_uptime_seconds 1.5"})
    EXPECT_TRUE(has_line(line)) << line << " is not in\n" << text();
  EXPECT_EQ(text().find("\nthrowcal_worst_sigma_rotation_radians "), std::string::npos);
}

TEST(Metrics, SayNothingOfABusWhereThereIsNone) {
  Json without = status;
  without["can"] = nullptr;
  EXPECT_EQ(to_metrics(without, {}).find("throwcal_can"), std::string::npos);
}

TEST(Metrics, EachLineIsOfTheFormat) {
  const std::regex format(
      R"re(# (HELP|TYPE) [a-z_]+ .+|[a-z_]+(\{[a-z]+="([^"\\]|\\["\\n])*"\})? -?[0-9.e+-]+)re");
  std::istringstream lines(text());
  for (std::string line; std::getline(lines, line);)
    EXPECT_TRUE(std::regex_match(line, format)) << line;
  EXPECT_TRUE(text().ends_with("\n"));
}

}  // namespace
}  // namespace throwcal
