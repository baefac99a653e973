// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/http_routes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>

#include "firmware/sha256.h"
#include "tests/support/temporary_folder.h"

namespace throwcal {
namespace {

using Json = JsonRpc::Json;

/// A box without anything behind it.
class Routes : public ::testing::Test {
 protected:
  static constexpr std::size_t content_bytes = 2 * FileDigests::piece_bytes + 1;

  Routes() {
    using Caller = JsonRpc::Caller;
    std::ofstream(file) << std::string(content_bytes, 'x');
    rpc.add("auth", [](const Json& params, Caller& caller) {
      caller.knows_token = params.at("token") == "secret99";
      if (!caller.knows_token) throw RpcError(rpc_forbidden, "not the token");
      return Json::object();
    });
    rpc.add("status.get", [this](const Json&, Caller&) { return status; });
    rpc.add("calibration.latest", [](const Json&, Caller&) { return Json{{"id", 1}}; });
    rpc.add("calibration.get", [](const Json& params, Caller&) -> Json {
      if (!params.at("id").is_number_integer()) throw RpcError(rpc_invalid_params, "id!");
      if (params.at("id") != 1) throw RpcError(rpc_refused, "there is none");
      return {{"id", 1}};
    });
    rpc.add("session.get", [](const Json& params, Caller&) -> Json {
      if (!params.at("session").is_number_integer()) throw RpcError(rpc_invalid_params, "session!");
      if (params.at("session") != 7 && params.at("session") != 8)
        throw RpcError(rpc_refused, "there is none");
      return {{"session", params.at("session")}};
    });
    rpc.add_change("session.delete", [this](const Json& params, Caller&) -> Json {
      if (params.at("session") != 7) throw RpcError(rpc_refused, "not there, or under way");
      ++deletions;
      return {{"deleted", 7}};
    });
    rpc.add("system.info", [](const Json&, Caller&) -> Json { throw std::runtime_error("fire"); });
    rpc.add_change("capture.start", [this](const Json&, Caller&) { return Json(++starts); });
    rpc.add_change("capture.stop",
                   [](const Json&, Caller&) -> Json { throw RpcError(rpc_refused, "not now"); });
  }

  /// With all the work that is in it done.
  HttpReply whole(HttpReply reply) {
    while (reply.work) reply = routes.further(reply);
    return reply;
  }
  HttpReply get(const std::string& target) { return whole(routes.reply({"GET", target})); }
  HttpReply post(const std::string& target, const std::string& token = "secret99",
                 HttpHeaders headers = {}, const std::string& body = "") {
    if (!token.empty()) headers.authorization = "Bearer " + token;
    return routes.reply({"POST", target, headers, body});
  }
  static std::string header(const HttpReply& reply, const std::string& name) {
    for (const auto& [key, value] : reply.headers)
      if (key == name) return value;
    return "none";
  }

  Json status{{"state", "idle"},
              {"fault", nullptr},
              {"cameras", {{{"name", "north"}, {"running", true}, {"error", nullptr}}}}};
  HttpReply remove(const std::string& target, HttpHeaders headers = {},
                   const std::string& body = "") {
    headers.authorization = "Bearer secret99";
    return routes.reply({"DELETE", target, headers, body});
  }
  std::optional<std::filesystem::path> file_of(std::int64_t session) const {
    if (is_cut) throw RpcError(rpc_refused, "its last writes lie in a log beside it");
    return session == 7 ? std::optional(file) : std::nullopt;
  }

  int starts = 0, deletions = 0;
  bool is_cut = false;
  test::TemporaryFolder folder;
  std::filesystem::path file = folder.path() / "000007.throwcal";
  JsonRpc rpc;
  std::shared_ptr<const Preview> preview = std::make_shared<const Preview>(Preview{"JPEG", "1,2"});
  HttpRoutes routes{rpc,
                    {{"north"},
                     [this](CameraId) { return preview; },
                     [] { return std::string("metrics"); },
                     [] { return std::string("tar"); },
                     [this](std::int64_t session) { return file_of(session); }}};
};

TEST_F(Routes, ADocumentIsJsonRpcs) {
  const HttpReply reply = get("/api/v1/status?x");
  EXPECT_EQ(reply.status, http_ok);
  EXPECT_EQ(*reply.body, JsonRpc::to_line(status));
  EXPECT_EQ(reply.content_type, "application/json");
  EXPECT_EQ(header(reply, "Cache-Control"), "no-store");
}

TEST_F(Routes, EachFaultHasItsStatus) {
  const struct {
    std::string method, target;
    unsigned status;
  } cases[] = {
      {"GET", "/nothing", 404},
      {"GET", "/api/v1", 404},
      {"GET", "/api/v1/status/", 400},
      {"GET", "*", 400},
      {"POST", "/api/v1/status", 405},
      {"DELETE", "/api/v1/calibration/1", 405},
      {"GET", "/api/v1/capture/start", 405},
      {"GET", "/api/v1/system", 500},
      {"GET", "/api/v1/cameras", 404},  // this box has no such method
      {"GET", "/api/v1/calibration/1", 200},
      {"GET", "/api/v1/calibration/2", 404},
      {"GET", "/api/v1/calibration/one", 400},
      {"GET", "/api/v1/calibration/99999999999999999999", 400},
      {"GET", "/api/v1/cameras/south/preview.jpg", 404},
      {"GET", "/api/v1/cameras/south/preview.mjpeg", 404},
      {"GET", "/api/v1/sessions/7", 200},
      {"GET", "/api/v1/sessions/9", 404},
      {"GET", "/api/v1/sessions/seven", 400},
      {"GET", "/api/v1/sessions/9/file", 404},
      {"GET", "/api/v1/sessions/seven/file", 400},
      {"GET", "/api/v1/sessions/8/file", 409},  // under way
      {"POST", "/api/v1/sessions/7", 405},
      {"DELETE", "/api/v1/sessions/7/file", 405},
      {"DELETE", "/api/v1/sessions", 405},
      {"DELETE", "/api/v1/sessions/7", 401},
  };
  for (const auto& one : cases) {
    const HttpReply reply = whole(routes.reply({one.method, one.target}));
    EXPECT_EQ(reply.status, one.status) << one.target;
    const Json body = Json::parse(*reply.body);
    EXPECT_EQ(body.contains("error"), one.status != 200) << one.target;
  }
  EXPECT_EQ(header(routes.reply({"PUT", "/api/v1/capture/stop"}), "Allow"), "POST");
  EXPECT_EQ(header(routes.reply({"PUT", "/metrics"}), "Allow"), "GET, HEAD");
  EXPECT_EQ(header(routes.reply({"PUT", "/api/v1/sessions/7"}), "Allow"), "GET, HEAD, DELETE");
  EXPECT_EQ(header(routes.reply({"GET, HEAD", "/metrics"}), "Allow"), "GET, HEAD");
}

TEST_F(Routes, WhatChangesSomethingNeedsTheToken) {
  for (const std::string token : {"", "wrong000"}) {
    const HttpReply reply = post("/api/v1/capture/start", token);
    EXPECT_EQ(reply.status, http_unauthorized) << token;
    EXPECT_EQ(header(reply, "WWW-Authenticate"), "Bearer realm=\"throwcal\"");
  }
  HttpHeaders basic;
  basic.authorization = "Basic secret99";
  EXPECT_EQ(post("/api/v1/capture/start", "", basic).status, http_unauthorized);
  EXPECT_EQ(starts, 0);
  EXPECT_EQ(post("/api/v1/capture/start").status, http_ok);
  EXPECT_EQ(starts, 1);
  EXPECT_EQ(post("/api/v1/capture/stop").status, http_conflict);
}

TEST_F(Routes, APageOfAnotherSiteChangesNothing) {
  HttpHeaders headers;
  headers.host = "box:8080";
  headers.origin = "http://elsewhere";
  EXPECT_EQ(post("/api/v1/capture/start", "secret99", headers).status, http_forbidden);
  headers.origin = "http://box:8080";
  EXPECT_EQ(post("/api/v1/capture/start", "secret99", headers).status, http_ok);
}

TEST_F(Routes, AKeyMakesItHappenOnce) {
  HttpHeaders headers;
  headers.idempotency_key = "k1";
  const auto first = post("/api/v1/capture/start", "secret99", headers);
  const auto again = post("/api/v1/capture/start", "secret99", headers);
  EXPECT_EQ(*first.body, "1");
  EXPECT_EQ(*again.body, "1");
  EXPECT_EQ(*post("/api/v1/capture/start", "secret99", {}, R"({"key": "k1"})").body, "1");
  EXPECT_EQ(starts, 1);
  EXPECT_EQ(post("/api/v1/capture/start", "secret99", headers, R"({"key":"k2"})").status, 400u);
  headers.idempotency_key = std::string(65, 'k');
  EXPECT_EQ(post("/api/v1/capture/start", "secret99", headers).status, http_bad_request);
  EXPECT_EQ(starts, 1);
}

TEST_F(Routes, ABodyIsAnObjectOrNothing) {
  for (const std::string body : {"[]", "7", "{", "\xff", "{\"a\":1}x"})
    EXPECT_EQ(post("/api/v1/capture/start", "secret99", {}, body).status, http_bad_request) << body;
  EXPECT_EQ(post("/api/v1/capture/start", "secret99", {}, "{}").status, http_ok);
}

TEST_F(Routes, ACalibrationHasAStrongTag) {
  const HttpReply reply = get("/api/v1/calibration/latest");
  const std::string hash = sha256_hex(*reply.body);
  EXPECT_EQ(header(reply, "ETag"), "\"" + hash + "\"");
  EXPECT_EQ(header(reply, "X-Content-SHA256"), hash);
  EXPECT_EQ(header(reply, "Cache-Control"), "no-cache");
  HttpRequest again{"GET", "/api/v1/calibration/latest"};
  again.headers.if_none_match = "\"x\", \"" + hash + "\"";
  const HttpReply known = routes.reply(again);
  EXPECT_EQ(known.status, http_not_modified);
  EXPECT_TRUE(known.body->empty());
  EXPECT_EQ(header(known, "ETag"), "\"" + hash + "\"");
  again.headers.if_none_match = "\"x\"";
  EXPECT_EQ(routes.reply(again).status, http_ok);
}

TEST_F(Routes, ADigestIsWrittenAsRfc9530Says) {
  HttpReply reply = text_reply("{\"hello\": \"world\"}\n");  // its appendix D's example
  add_digest(reply);
  EXPECT_EQ(header(reply, "Repr-Digest"), "sha-256=:RK/0qy18MlBSVnWgjwz6lZEWjP/lF5HF9bvEF8FabDg=:");
}

TEST_F(Routes, ABoxThatIsNotWellSaysWhy) {
  EXPECT_EQ(*get("/healthz").body, "ok\n");
  status["cameras"][0]["running"] = false;
  EXPECT_EQ(get("/healthz").status, http_unavailable);
  EXPECT_EQ(*get("/healthz").body, "camera \"north\" is not running\n");
  status["cameras"][0]["error"] = "unplugged";
  EXPECT_EQ(*get("/healthz").body, "camera \"north\": unplugged\n");
  status["fault"] = "disk full";
  EXPECT_EQ(*get("/healthz").body, "disk full\n");
}

TEST_F(Routes, APictureIsOfACameraThatDelivers) {
  const HttpReply reply = get("/api/v1/cameras/north/preview.jpg");
  EXPECT_EQ(*reply.body, "JPEG");
  EXPECT_EQ(header(reply, "X-Balls"), "1,2");
  EXPECT_EQ(get("/api/v1/cameras/north/preview.mjpeg").stream->camera, CameraId{0});
  EXPECT_FALSE(get("/api/v1/events").stream->camera);
  preview = nullptr;
  EXPECT_EQ(get("/api/v1/cameras/north/preview.jpg").status, http_unavailable);
  preview = std::make_shared<const Preview>();
  status["cameras"][0]["error"] = "unplugged";
  for (const char* name : {"preview.jpg", "preview.mjpeg"}) {
    const HttpReply refused = get(std::string("/api/v1/cameras/north/") + name);
    EXPECT_EQ(refused.status, http_unavailable);
    EXPECT_NE(refused.body->find("unplugged"), std::string::npos);
  }
}

TEST_F(Routes, APictureIsNotMadeAtOnce) {
  const HttpReply reply = routes.reply({"GET", "/api/v1/cameras/north/preview.jpg"});
  EXPECT_TRUE(reply.work);
  EXPECT_TRUE(reply.body->empty());
}

TEST_F(Routes, ASessionsFileIsDigestedInPiecesAndHasAStrongTag) {
  HttpRequest request{"GET", "/api/v1/sessions/7/file"};
  HttpReply reply = routes.reply(request);
  int pieces = 1;
  for (; reply.work; ++pieces) reply = routes.further(reply);
  EXPECT_EQ(pieces, 3);
  const std::string hash = sha256_hex(std::string(content_bytes, 'x'));
  EXPECT_EQ(reply.status, http_ok);
  ASSERT_TRUE(reply.file);
  EXPECT_EQ(reply.file->bytes(), content_bytes);
  EXPECT_EQ(header(reply, "ETag"), "\"" + hash + "\"");
  EXPECT_EQ(header(reply, "X-Content-SHA256"), hash);
  EXPECT_EQ(header(reply, "Cache-Control"), "no-cache");
  EXPECT_EQ(header(reply, "Content-Disposition"), "attachment; filename=\"000007.throwcal\"");
  reply = routes.reply(request);
  EXPECT_FALSE(reply.work) << "the digest is known now";
  EXPECT_EQ(header(reply, "X-Content-SHA256"), hash);
  request.headers.if_none_match = "\"" + hash + "\"";
  reply = routes.reply(request);
  EXPECT_EQ(reply.status, http_not_modified);
  EXPECT_FALSE(reply.file);
}

TEST_F(Routes, ASessionsFileIsWholeOrRefused) {
  is_cut = true;
  EXPECT_EQ(get("/api/v1/sessions/7/file").status, http_conflict);
  is_cut = false;
  HttpReply reply = routes.reply({"GET", "/api/v1/sessions/7/file"});
  ASSERT_TRUE(reply.work);
  std::ofstream(file, std::ios::app) << "more";
  reply = whole(reply);
  EXPECT_EQ(reply.status, http_internal_error) << "written to while it was read";
  EXPECT_FALSE(reply.file);
  EXPECT_EQ(get("/api/v1/sessions/7/file").file->bytes(), content_bytes + 4) << "asked again";
  std::filesystem::remove(file);
  EXPECT_EQ(get("/api/v1/sessions/7/file").status, http_internal_error);
}

TEST_F(Routes, ASessionIsDeletedOnce) {
  HttpHeaders headers;
  headers.origin = "http://elsewhere";
  EXPECT_EQ(remove("/api/v1/sessions/7", headers).status, http_forbidden);
  EXPECT_EQ(remove("/api/v1/sessions/seven").status, http_bad_request);
  EXPECT_EQ(remove("/api/v1/sessions/7", {}, "[]").status, http_bad_request);
  EXPECT_EQ(remove("/api/v1/sessions/7", {}, R"({"session": 6})").status, http_bad_request);
  EXPECT_EQ(remove("/api/v1/sessions/8").status, http_conflict);
  EXPECT_EQ(remove("/api/v1/sessions/9").status, http_not_found);
  EXPECT_EQ(deletions, 0);
  headers = {};
  headers.idempotency_key = "k1";
  EXPECT_EQ(*remove("/api/v1/sessions/7", headers).body, R"({"deleted":7})");
  EXPECT_EQ(remove("/api/v1/sessions/7", headers).status, http_ok) << "asked again";
  EXPECT_EQ(deletions, 1);
}

TEST_F(Routes, ThePageReachesNothingElse) {
  const HttpReply reply = get("/");
  EXPECT_EQ(reply.content_type, "text/html; charset=utf-8");
  EXPECT_TRUE(header(reply, "Content-Security-Policy").starts_with("default-src 'none'; "));
  EXPECT_EQ(reply.body->find("://"), std::string::npos) << "it names something outside";
  EXPECT_EQ(*get("/index.html").body, *reply.body);
}

}  // namespace
}  // namespace throwcal
