// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/http_routes.h"

#include <algorithm>
#include <charconv>

#include "firmware/metrics.h"
#include "firmware/page_files.h"

namespace throwcal {
namespace {

using Json = JsonRpc::Json;

/// What stands in the way of an answer, where JSON-RPC has no code for it.
struct HttpError : std::runtime_error {
  HttpError(HttpStatus status_, int code_, const std::string& message)
      : std::runtime_error(message), status(status_), code(code_) {}
  HttpStatus status;
  int code;
};

/// The page reads this box and nothing else, and nothing else may show it in a frame.
constexpr const char* page_policy =
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

const std::vector<std::string> reads{"GET", "HEAD"}, posts{"POST"}, removes{"DELETE"};

std::string content_type_of(std::string_view file) {
  if (file.ends_with(".html")) return "text/html; charset=utf-8";
  if (file.ends_with(".js")) return "text/javascript; charset=utf-8";
  return "text/css; charset=utf-8";
}

/// A whole number where it is one; else the text, which JSON-RPC refuses in its own words.
Json id_in(const std::string& text) {
  std::int64_t id = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), id);
  return error == std::errc{} && end == text.data() + text.size() ? Json(id) : Json(text);
}

/// Gives params a value that stands elsewhere, too: `where`.
void set(Json& params, const std::string& name, const Json& value, const std::string& where) {
  if (params.contains(name) && params.at(name) != value)
    throw HttpError(http_bad_request, rpc_invalid_params,
                    "the body's " + name + " is another one than the " + where);
  params[name] = value;
}

/// What a request brings: its body, an object or nothing, with the Idempotency-Key as `key`.
Json params_of(const HttpRequest& request) {
  Json params = Json::object();
  if (!request.body.empty()) params = Json::parse(request.body, nullptr, false);
  if (!params.is_object())
    throw HttpError(http_bad_request, rpc_parse_error,
                    "the body must be a JSON object, or there must be none");
  if (request.headers.idempotency_key)
    set(params, "key", *request.headers.idempotency_key, "header's (Idempotency-Key)");
  return params;
}

/// A page of somewhere else, in whose reader's browser the box is within reach, changes nothing.
void refuse_foreign_page(const HttpHeaders& headers) {
  if (headers.origin && !is_own_page(*headers.origin, headers.host.value_or("")))
    throw HttpError(http_forbidden, rpc_forbidden,
                    "this request comes from a page of another site (Origin)");
}

bool has_form(const std::vector<std::string>& pattern, const std::vector<std::string>& path) {
  return std::ranges::equal(pattern, path, [](const std::string& want, const std::string& is) {
    return want == "*" || want == is;
  });
}

std::string taken_by(const std::vector<std::string>& pattern,
                     const std::vector<std::string>& path) {
  const auto star = std::ranges::find(pattern, "*");
  return star == pattern.end() ? "" : path[static_cast<std::size_t>(star - pattern.begin())];
}

HttpReply method_not_allowed(const std::string& allowed) {
  HttpReply reply =
      error_reply(http_method_not_allowed, rpc_invalid_request, "this is for " + allowed + " only");
  reply.headers.emplace_back("Allow", allowed);
  return reply;
}

}  // namespace

std::vector<HttpRoutes::Route> HttpRoutes::routes() {
  using Request = HttpRequest;
  using Text = std::string;
  const auto shows = [this](const char* method) {
    return [this, method](const Request&, const Text&) { return document(method); };
  };
  const auto keeps = [this](const char* method) {
    return [this, method](const Request& r, const Text&) { return kept_document(r, method); };
  };
  const auto changes = [this](const char* method) {
    return [this, method](const Request& r, const Text&) { return change(r, method); };
  };
  const auto file = [this](const char* name) {
    return [this, name](const Request& r, const Text&) { return page(r, name); };
  };
  std::vector<Route> all{
      {{"api", "v1", "status"}, reads, shows("status.get")},
      {{"api", "v1", "cameras"}, reads, shows("camera.list")},
      {{"api", "v1", "system"}, reads, shows("system.info")},
      {{"api", "v1", "calibration"}, reads, keeps("calibration.list")},
      {{"api", "v1", "calibration", "latest"}, reads, keeps("calibration.latest")},
      {{"api", "v1", "calibration", "*"},
       reads,
       [this](const Request& r, const Text& id) {
         return document_of(r, "calibration.get", {{"id", id_in(id)}});
       }},
      {{"api", "v1", "sessions"}, reads, keeps("session.list")},
      {{"api", "v1", "sessions", "*"},
       reads,
       [this](const Request& r, const Text& id) {
         return document_of(r, "session.get", {{"session", id_in(id)}});
       }},
      {{"api", "v1", "sessions", "*"},
       removes,
       [this](const Request& r, const Text& id) { return delete_session(r, id); }},
      {{"api", "v1", "sessions", "*", "file"},
       reads,
       [this](const Request& r, const Text& id) { return session_file(r, id); }},
      {{"api", "v1", "capture", "start"}, posts, changes("capture.start")},
      {{"api", "v1", "capture", "stop"}, posts, changes("capture.stop")},
      {{"api", "v1", "capture", "abort"}, posts, changes("capture.abort")},
      {{"api", "v1", "events"},
       reads,
       [](const Request&, const Text&) {
         return HttpReply{.content_type = "text/event-stream", .stream = HttpStream{}};
       }},
      {{"api", "v1", "cameras", "*", "preview.jpg"},
       reads,
       [this](const Request&, const Text& name) {
         return HttpReply{.work = [this, name] { return picture(name); }};
       }},
      {{"api", "v1", "cameras", "*", "preview.mjpeg"},
       reads,
       [this](const Request&, const Text& name) {
         return HttpReply{.work = [this, name] { return pictures(name); }};
       }},
      {{"api", "v1", "support"}, reads, [this](const Request&, const Text&) { return support(); }},
      {{"metrics"},
       reads,
       [this](const Request&, const Text&) {
         HttpReply reply = text_reply(sources_.metrics());
         reply.content_type = "text/plain; version=0.0.4; charset=utf-8";
         return reply;
       }},
      {{"healthz"}, reads, [this](const Request&, const Text&) { return health(); }},
      {{}, reads, file("index.html")}};
  for (const PageFile& one : page_files())
    all.push_back({{std::string(one.name)}, reads, file(one.name.data())});
  return all;
}

HttpReply HttpRoutes::reply(const HttpRequest& request) {
  return guarded([&] { return routed(request); });
}

HttpReply HttpRoutes::further(const HttpReply& reply) { return guarded(reply.work); }

HttpReply HttpRoutes::guarded(const std::function<HttpReply()>& make) {
  HttpReply reply;
  try {
    reply = make();
  } catch (const HttpError& error) {
    reply = error_reply(error.status, error.code, error.what());
  } catch (const RpcError& refusal) {
    reply = error_reply(status_of(refusal.code), refusal.code, refusal.what());
  } catch (const std::exception& fault) {
    reply = error_reply(http_internal_error, rpc_internal_error, fault.what());
  }
  if (reply.work) return reply;
  if (reply.status == http_unauthorized)
    reply.headers.emplace_back("WWW-Authenticate", "Bearer realm=\"throwcal\"");
  reply.headers.emplace_back("X-Content-Type-Options", "nosniff");
  const bool may_be_kept =
      std::ranges::any_of(reply.headers, [](const auto& header) { return header.first == "ETag"; });
  reply.headers.emplace_back("Cache-Control", may_be_kept ? "no-cache" : "no-store");
  return reply;
}

HttpReply HttpRoutes::routed(const HttpRequest& request) {
  const auto path = path_segments(request.target);
  if (!path)
    throw HttpError(http_bad_request, rpc_invalid_request,
                    "the request's target must be a path like /api/v1/status");
  const auto first =
      std::ranges::find_if(routes_, [&](const Route& one) { return has_form(one.pattern, *path); });
  if (first == routes_.end())
    throw HttpError(http_not_found, rpc_method_not_found,
                    "there is no such page; the README lists them");
  std::string allowed;
  for (auto route = first; route != routes_.end() && route->pattern == first->pattern; ++route)
    for (const std::string& method : route->methods) {
      if (method == request.method) return route->answer(request, taken_by(route->pattern, *path));
      allowed += (allowed.empty() ? "" : ", ") + method;
    }
  return method_not_allowed(allowed);
}

HttpReply HttpRoutes::document(const std::string& method, const Json& params) {
  JsonRpc::Caller nobody;
  return json_reply(rpc_.call(method, params, nobody));
}

HttpReply HttpRoutes::kept_document(const HttpRequest& request, const std::string& method,
                                    const Json& params) {
  HttpReply reply = document(method, params);
  add_digest(reply);
  return unless_known(std::move(reply), request.headers.if_none_match);
}

/// What JSON-RPC refuses is, by name, not found.
HttpReply HttpRoutes::document_of(const HttpRequest& request, const std::string& method,
                                  const Json& params) {
  try {
    return kept_document(request, method, params);
  } catch (const RpcError& refusal) {
    if (refusal.code != rpc_refused) throw;
    throw HttpError(http_not_found, refusal.code, refusal.what());
  }
}

HttpReply HttpRoutes::change(const HttpRequest& request, const std::string& method,
                             const Json& named) {
  refuse_foreign_page(request.headers);
  Json params = params_of(request);
  for (const auto& [name, value] : named.items()) set(params, name, value, "path's");
  JsonRpc::Caller caller;
  if (request.headers.authorization) {
    const auto token = bearer_token(*request.headers.authorization);
    if (!token)
      throw HttpError(http_unauthorized, rpc_forbidden,
                      "expected the header Authorization: Bearer TOKEN");
    rpc_.call("auth", {{"token", *token}}, caller);
  }
  return json_reply(rpc_.call(method, params, caller));
}

HttpReply HttpRoutes::session_file(const HttpRequest& request, const std::string& id) {
  document_of({}, "session.get", {{"session", id_in(id)}});
  const auto path = sources_.session_file(id_in(id).get<std::int64_t>());
  if (!path) throw RpcError(rpc_refused, "session " + id + " is under way: stop it first");
  HttpReply reply{.content_type = "application/vnd.sqlite3"};
  reply.headers.emplace_back("Content-Disposition",
                             "attachment; filename=\"" + path->filename().string() + "\"");
  reply.file = std::make_shared<const OutgoingFile>(*path);
  return digested(std::move(reply), request.headers.if_none_match);
}

HttpReply HttpRoutes::digested(HttpReply reply, const std::optional<std::string>& if_none_match) {
  if (const auto digest = digests_.look_further(*reply.file)) {
    add_digest(reply, *digest);
    return unless_known(std::move(reply), if_none_match);
  }
  HttpReply later{.file = reply.file};
  later.work = [=, this] { return digested(reply, if_none_match); };
  return later;
}

/// What is refused is under way, or is not there.
HttpReply HttpRoutes::delete_session(const HttpRequest& request, const std::string& id) {
  const Json named{{"session", id_in(id)}};
  try {
    return change(request, "session.delete", named);
  } catch (const RpcError& refusal) {
    if (refusal.code == rpc_refused) document_of({}, "session.get", named);
    throw;
  }
}

HttpReply HttpRoutes::support() {
  HttpReply reply = text_reply(sources_.support_bundle());
  reply.content_type = "application/x-tar";
  reply.headers.emplace_back("Content-Disposition",
                             "attachment; filename=\"throwcal-support.tar\"");
  return reply;
}

Json HttpRoutes::status() {
  JsonRpc::Caller nobody;
  return rpc_.call("status.get", Json::object(), nobody);
}

HttpReply HttpRoutes::health() {
  const auto what = illness(status());
  return what ? text_reply(*what + "\n", http_unavailable) : text_reply("ok\n");
}

CameraId HttpRoutes::camera_of(const std::string& name) const {
  const auto found = std::ranges::find(sources_.camera_names, name);
  if (found == sources_.camera_names.end())
    throw HttpError(http_not_found, rpc_method_not_found, "there is no such camera");
  return static_cast<CameraId>(found - sources_.camera_names.begin());
}

/// Of a camera that delivers now: an old picture of one that doesn't would pass for what is there.
std::shared_ptr<const Preview> HttpRoutes::preview_of(const std::string& camera) {
  const CameraId id = camera_of(camera);
  const Json now = status().at("cameras").at(id);
  const auto fail = [&](const std::string& why) {
    throw HttpError(http_unavailable, rpc_refused, "camera \"" + camera + "\": " + why);
  };
  if (now.at("error").is_string()) fail(now.at("error").get<std::string>());
  if (now.at("running") != true) fail("it is not running");
  auto preview = sources_.preview(id);
  if (!preview) fail("it has not delivered a picture yet");
  return preview;
}

HttpReply HttpRoutes::picture(const std::string& camera) {
  const auto preview = preview_of(camera);
  HttpReply reply;
  reply.content_type = "image/jpeg";
  reply.body = std::shared_ptr<const std::string>(preview, &preview->jpeg);
  reply.headers.emplace_back("X-Balls", preview->balls);
  return reply;
}

HttpReply HttpRoutes::pictures(const std::string& camera) {
  preview_of(camera);
  return {.content_type = "multipart/x-mixed-replace; boundary=throwcal",
          .stream = HttpStream{camera_of(camera)}};
}

HttpReply HttpRoutes::page(const HttpRequest& request, const std::string& name) {
  const auto file = std::ranges::find(page_files(), name, &PageFile::name);
  HttpReply reply = text_reply(std::string(file->bytes));
  reply.content_type = content_type_of(name);
  reply.headers.emplace_back("Content-Security-Policy", page_policy);
  reply.headers.emplace_back("Referrer-Policy", "no-referrer");
  add_digest(reply);
  return unless_known(std::move(reply), request.headers.if_none_match);
}

}  // namespace throwcal
