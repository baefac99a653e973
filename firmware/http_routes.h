// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "firmware/http_reply.h"
#include "firmware/http_request.h"
#include "firmware/json_rpc.h"
#include "firmware/preview.h"

namespace throwcal {

/// What the routes show beside JSON-RPC's documents.
struct HttpSources {
  std::vector<std::string> camera_names;
  /// A camera's newest picture; null where there is none.
  std::function<std::shared_ptr<const Preview>(CameraId)> preview;
  std::function<std::string()> metrics, support_bundle;
};

/// Which request gets which answer. The documents are those of JSON-RPC, by its call(): what may be
/// changed by whom is decided there. Knows no sockets.
class HttpRoutes {
 public:
  HttpRoutes(JsonRpc& rpc, HttpSources sources) : rpc_(rpc), sources_(std::move(sources)) {}

  /// Never throws; every fault has its status.
  HttpReply reply(const HttpRequest& request);

  static constexpr std::size_t most_body_bytes = 64 * 1024;

 private:
  using Segments = std::vector<std::string>;
  /// A pattern's segment "*" takes any; what it took is `taken`.
  struct Route {
    Segments pattern;
    bool changes = false;  ///< POST; else GET and HEAD
    std::function<HttpReply(const HttpRequest&, const std::string& taken)> answer;
  };

  std::vector<Route> routes();
  HttpReply routed(const HttpRequest& request);
  HttpReply document(const std::string& method, const JsonRpc::Json& params = {});
  HttpReply calibration(const HttpRequest& request, const std::string& method,
                        const JsonRpc::Json& params = {});
  HttpReply calibration_of(const HttpRequest& request, const std::string& id);
  HttpReply change(const HttpRequest& request, const std::string& method);
  HttpReply health();
  HttpReply picture(const std::string& camera);
  HttpReply pictures(const std::string& camera);
  HttpReply page(const HttpRequest& request, const std::string& name);
  JsonRpc::Json status();
  CameraId camera_of(const std::string& name) const;
  std::shared_ptr<const Preview> preview_of(const std::string& camera);

  JsonRpc& rpc_;
  HttpSources sources_;
  std::vector<Route> routes_ = routes();
};

}  // namespace throwcal
