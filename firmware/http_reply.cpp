// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/http_reply.h"

#include <algorithm>

#include "firmware/base64.h"
#include "firmware/http_request.h"

namespace throwcal {

HttpReply text_reply(std::string text, HttpStatus status) {
  return {.status = status,
          .content_type = "text/plain; charset=utf-8",
          .body = std::make_shared<const std::string>(std::move(text))};
}

/// The bytes are those that JSON-RPC has between "result": and the closing brace.
HttpReply json_reply(const JsonRpc::Json& document, HttpStatus status) {
  HttpReply reply = text_reply(JsonRpc::to_line(document), status);
  reply.content_type = "application/json";
  return reply;
}

HttpReply error_reply(HttpStatus status, int code, const std::string& message) {
  return json_reply({{"error", {{"code", code}, {"message", message}}}}, status);
}

HttpStatus status_of(int rpc_code) {
  switch (rpc_code) {
    case rpc_parse_error:
    case rpc_invalid_request:
    case rpc_invalid_params:
      return http_bad_request;
    case rpc_method_not_found:
      return http_not_found;
    case rpc_forbidden:
      return http_unauthorized;
    case rpc_refused:
      return http_conflict;
    default:
      return http_internal_error;
  }
}

void add_digest(HttpReply& reply) { add_digest(reply, sha256(*reply.body)); }

void add_digest(HttpReply& reply, const Sha256Digest& digest) {
  const std::string hex = to_hex(digest);
  const std::string_view bytes(reinterpret_cast<const char*>(digest.data()), digest.size());
  reply.headers.emplace_back("ETag", "\"" + hex + "\"");
  reply.headers.emplace_back("X-Content-SHA256", hex);
  reply.headers.emplace_back("Repr-Digest", "sha-256=:" + to_base64(bytes) + ":");
}

HttpReply unless_known(HttpReply reply, const std::optional<std::string>& if_none_match) {
  const auto tag =
      std::ranges::find(reply.headers, "ETag", &std::pair<std::string, std::string>::first);
  if (!if_none_match || tag == reply.headers.end() || !names_tag(*if_none_match, tag->second))
    return reply;
  reply.status = http_not_modified;
  reply.body = std::make_shared<const std::string>();
  reply.file = nullptr;
  return reply;
}

}  // namespace throwcal
