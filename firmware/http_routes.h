// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <filesystem>
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
  /// Of a session that is over; nothing of others. Throws RpcError where it is not whole.
  std::function<std::optional<std::filesystem::path>(std::int64_t session)> session_file;
};

/// Which request gets which answer. The documents are those of JSON-RPC, by its call(): what may be
/// changed by whom is decided there. Knows no sockets.
class HttpRoutes {
 public:
  HttpRoutes(JsonRpc& rpc, HttpSources sources) : rpc_(rpc), sources_(std::move(sources)) {}

  /// Never throws; every fault has its status. What takes long is left as the reply's `work`.
  HttpReply reply(const HttpRequest& request);
  /// Does some of that work; likewise.
  HttpReply further(const HttpReply& reply);

  static constexpr std::size_t most_body_bytes = 64 * 1024;

 private:
  using Segments = std::vector<std::string>;
  using Answer = std::function<HttpReply(const HttpRequest&, const std::string& taken)>;
  /// A pattern's segment "*" takes any; what it took is `taken`.
  struct Route {
    Segments pattern;
    std::vector<std::string> methods;
    Answer answer;
  };

  std::vector<Route> routes();
  HttpReply guarded(const std::function<HttpReply()>& make);
  HttpReply routed(const HttpRequest& request);
  HttpReply document(const std::string& method, const JsonRpc::Json& params = {});
  HttpReply kept_document(const HttpRequest& request, const std::string& method,
                          const JsonRpc::Json& params = {});
  HttpReply document_of(const HttpRequest& request, const std::string& method,
                        const JsonRpc::Json& params);
  /// `named`: the params that the path gives.
  HttpReply change(const HttpRequest& request, const std::string& method,
                   const JsonRpc::Json& named = JsonRpc::Json::object());
  HttpReply session_file(const HttpRequest& request, const std::string& id);
  HttpReply delete_session(const HttpRequest& request, const std::string& id);
  HttpReply digested(HttpReply reply, const std::optional<std::string>& if_none_match);
  HttpReply support();
  HttpReply health();
  HttpReply picture(const std::string& camera);
  HttpReply pictures(const std::string& camera);
  HttpReply page(const HttpRequest& request, const std::string& name);
  JsonRpc::Json status();
  CameraId camera_of(const std::string& name) const;
  std::shared_ptr<const Preview> preview_of(const std::string& camera);

  JsonRpc& rpc_;
  HttpSources sources_;
  FileDigests digests_;
  std::vector<Route> routes_ = routes();
};

}  // namespace throwcal
