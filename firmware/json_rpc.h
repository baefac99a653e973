// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>

namespace throwcal {

/// Codes of JSON-RPC 2.0, section 5.1, and ours.
enum RpcCode : int {
  rpc_parse_error = -32700,
  rpc_invalid_request = -32600,
  rpc_method_not_found = -32601,
  rpc_invalid_params = -32602,
  rpc_internal_error = -32603,
  rpc_refused = -32000,  ///< understood, but not possible now; the message says why
};

/// What a method throws to answer with an error.
struct RpcError : std::runtime_error {
  RpcError(int code_, const std::string& message) : std::runtime_error(message), code(code_) {}
  int code;
};

/// JSON-RPC 2.0 without a transport: a line in, the line to answer with out.
class JsonRpc {
 public:
  using Json = nlohmann::ordered_json;
  /// Who asks; lives as long as its connection.
  struct Caller {
    bool subscribed_to_status = false;
  };
  /// `params` is an object (an empty one where the request has none).
  using Method = std::function<Json(const Json& params, Caller& caller)>;

  void add(const std::string& name, Method method) { methods_[name] = std::move(method); }

  /// The answer, without its newline; nothing where none is due (notifications). Whatever bytes the
  /// line holds.
  std::optional<std::string> answer(std::string_view line, Caller& caller) const;

  static Json error(const Json& id, int code, const std::string& message);
  static Json notification(const std::string& method, Json params);
  static std::string to_line(const Json& message);  ///< never throws on invalid UTF-8

 private:
  std::optional<Json> answer_one(const Json& request, Caller& caller) const;
  Json call(const std::string& name, const Json& params, Caller& caller) const;

  std::map<std::string, Method, std::less<>> methods_;
};

}  // namespace throwcal
