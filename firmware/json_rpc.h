// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <deque>
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
  rpc_refused = -32000,    ///< understood, but not possible now; the message says why
  rpc_forbidden = -32001,  ///< it changes something, and the caller has shown no token
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
    bool knows_token = false;
  };
  /// `params` is an object (an empty one where the request has none).
  using Method = std::function<Json(const Json& params, Caller& caller)>;

  /// `anybody_may_change`: asked before a method that changes something is called by one who knows
  /// no token.
  explicit JsonRpc(std::function<bool()> anybody_may_change = [] { return false; })
      : anybody_may_change_(std::move(anybody_may_change)) {}

  /// A method that only reads.
  void add(const std::string& name, Method method) { methods_[name] = {std::move(method), false}; }
  /// A method that changes something: for those who may. With a `key` (a string of 1 to 64 bytes)
  /// in its params it is done once, however often it is asked for: who asks again with that key
  /// gets the first result again. The last 256 keys are remembered.
  void add_change(const std::string& name, Method method) {
    methods_[name] = {std::move(method), true};
  }

  /// The result of a method; throws RpcError, or what the method throws.
  Json call(const std::string& name, const Json& params, Caller& caller);
  /// The answer, without its newline; nothing where none is due (notifications). Whatever bytes the
  /// line holds.
  std::optional<std::string> answer(std::string_view line, Caller& caller);

  static Json error(const Json& id, int code, const std::string& message);
  static Json notification(const std::string& method, Json params);
  static std::string to_line(const Json& message);  ///< never throws on invalid UTF-8

 private:
  struct Entry {
    Method method;
    bool changes = false;
  };
  struct Done {
    std::string key;
    Json request, result;
  };

  std::optional<Json> answer_one(const Json& request, Caller& caller);
  Json change_once(const std::string& name, const Method& method, const Json& params,
                   Caller& caller);

  std::function<bool()> anybody_may_change_;
  std::map<std::string, Entry, std::less<>> methods_;
  std::deque<Done> done_;  ///< changes asked for with a key, oldest first
};

}  // namespace throwcal
