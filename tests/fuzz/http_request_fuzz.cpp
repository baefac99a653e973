// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <optional>

#include "firmware/http_routes.h"
#include "tests/fuzz/outside_text.h"

namespace throwcal {
namespace {

using Json = JsonRpc::Json;

/// Counts what was changed; the token is "fuzz-token".
struct SmallBox {
  int changes = 0;
  JsonRpc rpc;
  HttpRoutes routes{rpc,
                    {{"north"},
                     [](CameraId) { return std::make_shared<const Preview>(); },
                     [] { return std::string(); },
                     [] { return std::string(); },
                     [](std::int64_t) { return std::filesystem::path("/dev/null"); }}};

  SmallBox() {
    rpc.add("auth", [](const Json& params, JsonRpc::Caller& caller) {
      caller.knows_token = params.at("token") == "fuzz-token";
      return Json::object();
    });
    rpc.add("status.get", [](const Json&, JsonRpc::Caller&) -> Json {
      return {{"cameras", {{{"name", "north"}, {"running", true}, {"error", nullptr}}}}};
    });
    rpc.add("calibration.get", [](const Json& params, JsonRpc::Caller&) { return params; });
    rpc.add("session.get", [](const Json& params, JsonRpc::Caller&) {
      if (!params.at("session").is_number_integer()) throw RpcError(rpc_invalid_params, "session");
      return params;
    });
    rpc.add_change("session.delete", [this](const Json&, JsonRpc::Caller&) { return ++changes; });
    rpc.add_change("capture.start", [this](const Json&, JsonRpc::Caller&) { return ++changes; });
  }
};

/// A line of the input; nothing where it is empty or missing.
std::optional<std::string> next_line(std::string_view& rest) {
  const std::size_t end = std::min(rest.find('\n'), rest.size());
  const std::string line(rest.substr(0, end));
  rest.remove_prefix(std::min(end + 1, rest.size()));
  return line.empty() ? std::nullopt : std::optional(line);
}

}  // namespace
}  // namespace throwcal

/// Method, target and five headers, a line each; what follows is the body.
int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace throwcal;
  std::string_view rest = text_of(data, size);
  HttpRequest request;
  request.method = next_line(rest).value_or("");
  request.target = next_line(rest).value_or("");
  HttpHeaders& headers = request.headers;
  for (auto* header : {&headers.authorization, &headers.idempotency_key, &headers.if_none_match,
                       &headers.origin, &headers.host})
    *header = next_line(rest);
  request.body = rest;

  SmallBox box;
  HttpReply reply = box.routes.reply(request);
  while (reply.work) reply = box.routes.further(reply);
  require(reply.status >= 200 && reply.status <= 503, "every request has a status");
  for (const auto& [name, value] : reply.headers)
    for (const char c : name + value) require(c >= 0x20 && c < 0x7F, "a header is printable");
  if (reply.status >= 400 && request.target != "/healthz")
    require(Json::parse(*reply.body, nullptr, false).contains("error"), "a fault says what it is");
  if (box.changes > 0)
    require((request.method == "POST" || request.method == "DELETE") && headers.authorization &&
                headers.authorization->find("fuzz-token") != std::string::npos,
            "nothing changes without the token");
  if (const auto path = path_segments(request.target))
    for (const std::string& segment : *path)
      require(!segment.empty() && segment.find('\0') == std::string::npos &&
                  segment.find('/') == std::string::npos,
              "a segment is a name");
  return 0;
}
