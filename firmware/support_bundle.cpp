// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/support_bundle.h"

#include <microhttpd.h>
#include <sqlite3.h>

#include <opencv2/core/version.hpp>

#include "firmware/export.h"
#include "firmware/journal.h"
#include "firmware/tar_file.h"

namespace throwcal {
namespace {

constexpr std::size_t most_bytes_a_file = 1024 * 1024;
const std::string folder = "throwcal-support/";

/// What a method tells, or why it does not.
std::string told(JsonRpc& rpc, const std::string& method) {
  JsonRpc::Caller nobody;
  try {
    return rpc.call(method, Json::object(), nobody)
        .dump(1, ' ', false, Json::error_handler_t::replace);
  } catch (const std::exception& refusal) {
    return Json{{"error", refusal.what()}}.dump(1, ' ', false, Json::error_handler_t::replace);
  }
}

/// Where the token stands is nobody's business who is sent this.
std::string without_secrets(Config config) {
  config.token_file.reset();
  return to_toml(config);
}

std::string log_text() {
  std::string out;
  for (const std::string& line : recent_log_lines()) out += line + "\n";
  return out;
}

std::string versions() {
  return software_name() + "\nsqlite " + sqlite3_libversion() + "\nlibmicrohttpd " +
         MHD_get_version() + "\nopencv " CV_VERSION "\ncompiler " __VERSION__ "\n";
}

}  // namespace

std::string support_bundle(JsonRpc& rpc, const Config& config, const std::string& metrics) {
  TarFile tar(std::chrono::system_clock::now());
  const auto add = [&](const std::string& name, std::string content) {
    if (content.size() > most_bytes_a_file) {
      content.resize(most_bytes_a_file);
      content += "\n[cut here: too long]\n";
    }
    tar.add(folder + name, content);
  };
  add("versions.txt", versions());
  add("status.json", told(rpc, "status.get"));
  add("system.json", told(rpc, "system.info"));
  add("cameras.json", told(rpc, "camera.list"));
  add("sessions.json", told(rpc, "session.list"));
  add("calibrations.json", told(rpc, "calibration.list"));
  add("calibration-latest.json", told(rpc, "calibration.latest"));
  add("rig.toml", without_secrets(config));
  add("metrics.txt", metrics);
  add("log.txt", log_text());
  return std::move(tar).finish();
}

}  // namespace throwcal
