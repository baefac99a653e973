// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/metrics.h"

#include <sys/resource.h>
#include <unistd.h>

#include <cstdio>
#include <memory>

#include "firmware/text_file.h"

namespace throwcal {
namespace {

using Json = nlohmann::ordered_json;

/// Writes one metric after another, each with its HELP and TYPE once, then its samples.
class MetricsText {
 public:
  void begin(const std::string& name, const char* type, const char* help) {
    name_ = name;
    text_ += "# HELP " + name + " " + help + "\n# TYPE " + name + " " + type + "\n";
  }
  /// `value`: a number, true or false; anything else is left out. `label`: at most one.
  void sample(const Json& value, const std::string& label = {}, const std::string& is = {}) {
    if (!value.is_number() && !value.is_boolean()) return;
    text_ += name_;
    if (!label.empty()) text_ += "{" + label + "=\"" + escaped(is) + "\"}";
    const double number = value.is_boolean() ? (value.get<bool>() ? 1 : 0) : value.get<double>();
    text_ += " " + (value.is_number_integer() ? value.dump() : shortest(number)) + "\n";
  }
  std::string take() { return std::move(text_); }

 private:
  static std::string escaped(const std::string& text) {
    std::string out;
    for (const char c : text) {
      if (c == '\\' || c == '"') out += '\\';
      out += c == '\n' ? "\\n" : std::string(1, c);
    }
    return out;
  }

  std::string name_, text_;
};

/// Null where the document has no such key.
Json value_of(const Json& document, const char* key) { return document.value(key, Json()); }

struct CameraMetric {
  const char *key, *name, *type, *help;
};
constexpr CameraMetric camera_metrics[] = {
    {"running", "running", "gauge", "1: the camera delivers pictures."},
    {"frames", "frames_total", "counter", "Frames that the detector has looked at."},
    {"frames_per_s", "frames_per_second", "gauge", "Frames a second, over the last second or so."},
    {"frames_lost_by_driver", "frames_lost_total", "counter", "Frames lost before they came here."},
    {"frames_damaged", "frames_damaged_total", "counter", "Frames that the driver calls damaged."},
    {"frames_dropped", "frames_dropped_total", "counter",
     "Frames that the detector had no time for."},
    {"interruptions", "interruptions_total", "counter", "How often the camera was lost."},
    {"sightings", "sightings_total", "counter", "Ball-like things seen."},
    {"flights", "flights", "gauge", "Flights found in this session."},
    {"time_sigma_s", "time_sigma_seconds", "gauge", "1-sigma of a frame's time."},
};

void add_cameras(MetricsText& out, const Json& cameras) {
  for (const CameraMetric& metric : camera_metrics) {
    out.begin(std::string("throwcal_camera_") + metric.name, metric.type, metric.help);
    for (const Json& camera : cameras)
      out.sample(value_of(camera, metric.key), "camera", camera.at("name").get<std::string>());
  }
}

constexpr const char* can_counters[][2] = {
    {"frames_sent", "Frames that the bus took."},
    {"frames_lost", "Frames that could not be sent."},
    {"queue_full", "How often a frame was left out because the queue was full."},
    {"bus_off", "How often the controller left the bus."},
    {"error_passive", "How often the controller became error-passive."},
    {"tx_timeouts", "How often the controller could not send in time."},
    {"reopened", "How often the interface came back."},
    {"commands", "Command frames that came."},
    {"commands_ignored", "Command frames that were too many to be looked at."},
    {"wrong_keys", "Commands with a key that is not the box's."},
    {"blocks_sent", "Blocks of documents that were sent."},
    {"transfers_failed", "Blocks of documents that did not come to their end."},
};

/// Nothing where the box is on no bus.
void add_can(MetricsText& out, const Json& can) {
  if (!can.is_object()) return;
  out.begin("throwcal_can_state", "gauge", "1: how the bus is.");
  out.sample(1, "state", can.at("state").get<std::string>());
  for (const auto& [key, help] : can_counters) {
    out.begin(std::string("throwcal_can_") + key + "_total", "counter", help);
    out.sample(value_of(can, key));
  }
}

void add_session(MetricsText& out, const Json& status, const Target& target) {
  out.begin("throwcal_state", "gauge", "1: the state that the box is in.");
  out.sample(1, "state", status.at("state").get<std::string>());
  out.begin("throwcal_throws", "gauge", "Throws of this session.");
  out.sample(value_of(status, "throws"));
  out.begin("throwcal_worst_sigma_position_metres", "gauge",
            "1-sigma of the worst camera's position; none yet: left out.");
  out.sample(value_of(status, "worst_sigma_position_m"));
  out.begin("throwcal_worst_sigma_rotation_radians", "gauge",
            "1-sigma of the worst camera's rotation; none yet: left out.");
  out.sample(value_of(status, "worst_sigma_rotation_rad"));
  out.begin("throwcal_target_position_metres", "gauge", "The sigma that is enough.");
  out.sample(target.position_m);
  out.begin("throwcal_target_rotation_radians", "gauge", "The sigma that is enough.");
  out.sample(target.rotation_rad);
}

double resident_bytes() {
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen("/proc/self/statm", "re"),
                                                             std::fclose);
  unsigned long pages = 0;
  if (!file || std::fscanf(file.get(), "%*u %lu", &pages) != 1) return 0;
  return static_cast<double>(pages) * static_cast<double>(sysconf(_SC_PAGESIZE));
}

double processor_s() {
  rusage used{};
  getrusage(RUSAGE_SELF, &used);
  const auto seconds = [](const timeval& time) {
    return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
  };
  return seconds(used.ru_utime) + seconds(used.ru_stime);
}

void add_box(MetricsText& out, const Json& status, const BoxFigures& box) {
  out.begin("throwcal_info", "gauge", "Always 1; its label says what runs.");
  out.sample(1, "software", status.at("software").get<std::string>());
  out.begin("throwcal_uptime_seconds", "gauge", "Since the daemon began.");
  out.sample(value_of(status, "uptime_s"));
  out.begin("throwcal_fault", "gauge", "1: the box has a fault, as a store that can't be written.");
  out.sample(!value_of(status, "fault").is_null());
  out.begin("throwcal_calibration_problem", "gauge",
            "1: the last calibration is not of these cameras.");
  out.sample(!value_of(status, "calibration_problem").is_null());
  out.begin("throwcal_sightings_dropped_total", "counter",
            "Frames' worth of sightings that the estimator had no time for.");
  out.sample(value_of(status, "sightings_dropped"));
  out.begin("throwcal_tcp_clients", "gauge", "Clients connected by TCP.");
  out.sample(box.tcp_clients);
  out.begin("throwcal_http_connections", "gauge", "Connections by HTTP.");
  out.sample(box.http_connections);
  out.begin("process_resident_memory_bytes", "gauge", "Resident memory size in bytes.");
  out.sample(resident_bytes());
  out.begin("process_cpu_seconds_total", "counter", "Processor time of user and system.");
  out.sample(processor_s());
}

}  // namespace

std::string to_metrics(const Json& status, const BoxFigures& box) {
  MetricsText out;
  add_box(out, status, box);
  add_session(out, status, box.target);
  add_cameras(out, status.at("cameras"));
  add_can(out, value_of(status, "can"));
  return out.take();
}

std::optional<std::string> illness(const Json& status) {
  if (const Json fault = value_of(status, "fault"); fault.is_string())
    return fault.get<std::string>();
  for (const Json& camera : status.at("cameras")) {
    const std::string name = "camera \"" + camera.at("name").get<std::string>() + "\"";
    if (const Json error = value_of(camera, "error"); error.is_string())
      return name + ": " + error.get<std::string>();
    if (value_of(camera, "running") != true) return name + " is not running";
  }
  return {};
}

}  // namespace throwcal
