// SPDX-License-Identifier: BSD-3-Clause
#include <filesystem>
#include <limits>

#include "firmware/base64.h"
#include "firmware/daemon.h"
#include "firmware/text_file.h"

namespace throwcal {
namespace {

using Json = JsonRpc::Json;

constexpr std::size_t part_bytes = 48'000;  // of a session's file, in one answer

/// A calibration, or the refusal that says there is none.
Json found(const std::optional<Json>& document, const std::string& otherwise) {
  if (!document) throw RpcError(rpc_refused, otherwise);
  return *document;
}

std::int64_t required_number(const Json& params, const char* name, const char* where_from) {
  if (!params.contains(name) || !params.at(name).is_number_integer())
    throw RpcError(rpc_invalid_params,
                   std::string(name) + " must be a whole number, as " + where_from + " tells it");
  const Json& number = params.at(name);
  constexpr auto most = std::numeric_limits<std::int64_t>::max();
  const bool is_beyond = number.is_number_unsigned() && number.get<std::uint64_t>() > most;
  return is_beyond ? most : number.get<std::int64_t>();  // which is no id and no offset
}

std::int64_t required_id(const Json& params) {
  return required_number(params, "id", "calibration.list");
}

std::int64_t required_session(const Json& params) {
  return required_number(params, "session", "session.list");
}

/// capture.start's `until`: "target" (the default) or "stopped".
bool ends_itself(const Json& params) {
  const Json until = params.value("until", Json("target"));
  if (until != "target" && until != "stopped")
    throw RpcError(rpc_invalid_params, "until must be \"target\" or \"stopped\"");
  return until == "target";
}

/// A part of a session's file, which may be large: from `offset` on.
Json read_part(const Daemon& daemon, const Json& params) {
  const std::int64_t session = required_session(params);
  const std::int64_t offset =
      params.contains("offset") ? required_number(params, "offset", "the last part") : 0;
  const auto file = daemon.session_file(session);
  if (!file)
    throw RpcError(rpc_refused, "session " + std::to_string(session) +
                                    " is not there, or is under way: stop it first");
  std::error_code error;
  const auto bytes = std::filesystem::file_size(*file, error);
  if (!error && (offset < 0 || static_cast<std::uintmax_t>(offset) > bytes))
    throw RpcError(rpc_invalid_params, "offset must be 0 to " + std::to_string(bytes) +
                                           ", which is session " + std::to_string(session) +
                                           "'s whole file in bytes");
  const auto part = read_file_part(*file, offset, part_bytes);
  return {{"session", session},
          {"bytes", part.file_bytes},
          {"offset", offset},
          {"data", to_base64(part.bytes)}};
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
  rpc.add_change("capture.start", [&](const Json& params, Caller&) {
    return daemon.start_capture(ends_itself(params));
  });
  rpc.add_change("capture.stop", [&](const Json&, Caller&) { return daemon.stop_capture(); });
  rpc.add_change("capture.abort", [&](const Json&, Caller&) { return daemon.abort_capture(); });
  rpc.add("session.list", [&](const Json&, Caller&) { return daemon.store().session_list(); });
  rpc.add("session.get", [&](const Json& params, Caller&) {
    const std::int64_t id = required_session(params);
    return found(daemon.store().session(id), "there is no session " + std::to_string(id));
  });
  rpc.add("session.read", [&](const Json& params, Caller&) { return read_part(daemon, params); });
  rpc.add_change("session.delete", [&](const Json& params, Caller&) {
    return daemon.delete_session(required_session(params));
  });
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
