// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace throwcal {

/// A request's headers that are read here, as they came; nothing where it has none of that name.
struct HttpHeaders {
  std::optional<std::string> authorization, idempotency_key, if_none_match, origin, host;
};

/// One request, whole.
struct HttpRequest {
  std::string method;  ///< "GET", "HEAD", "POST"
  std::string target;  ///< as it stands in the request line: "/api/v1/status?x=1"
  HttpHeaders headers{};
  std::string body{};
};

/// The segments of a target's path, percent-decoded: "/api/v1/status" is {"api", "v1", "status"},
/// "/" none. The query is left out: nothing here has one. Nothing where it is no absolute path, or
/// holds what no name here does: control characters, "/" or "%" that were encoded, empty segments.
std::optional<std::vector<std::string>> path_segments(std::string_view target);

/// What `Authorization: Bearer TOKEN` shows; nothing where it is of another kind.
std::optional<std::string> bearer_token(std::string_view authorization);

/// Whether If-None-Match names this strong tag (with its quotes): by RFC 9110 a list, in which W/
/// makes no difference, or "*".
bool names_tag(std::string_view if_none_match, std::string_view tag);

/// Whether a page that was loaded from `origin` ("http://box:8080") is this host's own.
bool is_own_page(std::string_view origin, std::string_view host);

}  // namespace throwcal
