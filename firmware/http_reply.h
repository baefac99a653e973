// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "estimator/observation.h"
#include "firmware/json_rpc.h"
#include "firmware/outgoing_file.h"

namespace throwcal {

/// The status codes that are given here.
enum HttpStatus : unsigned {
  http_ok = 200,
  http_not_modified = 304,
  http_bad_request = 400,
  http_unauthorized = 401,
  http_forbidden = 403,
  http_not_found = 404,
  http_method_not_allowed = 405,
  http_conflict = 409,
  http_too_large = 413,
  http_internal_error = 500,
  http_unavailable = 503,
};

/// A body that does not end: what a client gets as it comes.
struct HttpStream {
  std::optional<CameraId> camera;  ///< its pictures; nothing: the status
};

/// An answer, before it is put on the wire.
struct HttpReply {
  HttpStatus status = http_ok;
  std::string content_type{};
  std::shared_ptr<const std::string> body = std::make_shared<const std::string>();
  std::vector<std::pair<std::string, std::string>> headers{};
  std::optional<HttpStream> stream{};          ///< then in place of `body`
  std::shared_ptr<const OutgoingFile> file{};  ///< likewise
  /// Not empty: this is no answer yet; it gives the answer, or one that is a little nearer to it.
  std::function<HttpReply()> work{};
};

HttpReply text_reply(std::string text, HttpStatus status = http_ok);
HttpReply json_reply(const JsonRpc::Json& document, HttpStatus status = http_ok);
/// {"error": {"code", "message"}}, the code JSON-RPC's.
HttpReply error_reply(HttpStatus status, int code, const std::string& message);
/// The status that an RpcError's code stands for.
HttpStatus status_of(int rpc_code);

/// Adds what lets a client check and keep the body: ETag (strong, its SHA-256), X-Content-SHA256
/// and Repr-Digest (RFC 9530).
void add_digest(HttpReply& reply);
void add_digest(HttpReply& reply, const Sha256Digest& digest);
/// The same answer without a body, 304, where the client has it already.
HttpReply unless_known(HttpReply reply, const std::optional<std::string>& if_none_match);

}  // namespace throwcal
