// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/daemon.h"

namespace throwcal {
namespace {

using Json = JsonRpc::Json;

/// A calibration, or the refusal that says there is none.
Json found(const std::optional<Json>& document, const std::string& otherwise) {
  if (!document) throw RpcError(rpc_refused, otherwise);
  return *document;
}

std::int64_t required_id(const Json& params) {
  if (!params.contains("id") || !params.at("id").is_number_integer())
    throw RpcError(rpc_invalid_params, "id must be a whole number, as calibration.list tells it");
  return params.at("id").get<std::int64_t>();
}

std::string required_text(const Json& params, const char* name) {
  if (!params.contains(name) || !params.at(name).is_string())
    throw RpcError(rpc_invalid_params, std::string(name) + " must be a string");
  return params.at(name).get<std::string>();
}

}  // namespace

void add_methods(JsonRpc& rpc, Daemon& daemon) {
  using Caller = JsonRpc::Caller;
  rpc.add("hello", [&](const Json&, Caller&) { return daemon.hello(); });
  rpc.add("auth", [&](const Json& params, Caller& caller) {
    daemon.authenticate(required_text(params, "token"), caller);
    return Json{{"ok", true}};
  });
  rpc.add("status.get", [&](const Json&, Caller&) { return daemon.status(); });
  rpc.add("status.subscribe", [&](const Json&, Caller& caller) {
    caller.subscribed_to_status = true;
    return daemon.status();
  });
  rpc.add_change("capture.start", [&](const Json&, Caller&) { return daemon.start_capture(); });
  rpc.add_change("capture.stop", [&](const Json&, Caller&) { return daemon.stop_capture(); });
  rpc.add("calibration.latest", [&](const Json&, Caller&) { return daemon.latest_calibration(); });
  rpc.add("calibration.list",
          [&](const Json&, Caller&) { return daemon.store().calibration_list(); });
  rpc.add("calibration.get", [&](const Json& params, Caller&) {
    const std::int64_t id = required_id(params);
    return found(daemon.store().calibration(id), "there is no calibration " + std::to_string(id));
  });
  rpc.add("camera.list", [&](const Json&, Caller&) { return daemon.camera_list(); });
  rpc.add("system.info", [&](const Json&, Caller&) { return daemon.system_info(); });
}

}  // namespace throwcal
