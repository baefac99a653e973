// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/json_rpc.h"

#include <algorithm>

namespace throwcal {
namespace {

constexpr std::size_t max_batch = 100, longest_key = 64, keys_remembered = 256;

bool is_id(const JsonRpc::Json& id) { return id.is_string() || id.is_number() || id.is_null(); }

/// Section 4: what makes an object a request.
std::optional<std::string> fault_of(const JsonRpc::Json& request) {
  if (!request.is_object()) return "a request must be an object";
  if (!request.contains("jsonrpc") || request.at("jsonrpc") != "2.0")
    return "jsonrpc must be \"2.0\"";
  if (!request.contains("method") || !request.at("method").is_string())
    return "method must be a string";
  if (request.contains("id") && !is_id(request.at("id")))
    return "id must be a string, a number or null";
  if (request.contains("params") && !request.at("params").is_structured())
    return "params must be an object or an array";
  return {};
}

}  // namespace

JsonRpc::Json JsonRpc::error(const Json& id, int code, const std::string& message) {
  return {{"jsonrpc", "2.0"}, {"id", id}, {"error", {{"code", code}, {"message", message}}}};
}

JsonRpc::Json JsonRpc::notification(const std::string& method, Json params) {
  return {{"jsonrpc", "2.0"}, {"method", method}, {"params", std::move(params)}};
}

std::string JsonRpc::to_line(const Json& message) {
  return message.dump(-1, ' ', false, Json::error_handler_t::replace);
}

JsonRpc::Json JsonRpc::call(const std::string& name, const Json& params, Caller& caller) {
  const auto found = methods_.find(name);
  if (found == methods_.end())
    throw RpcError(rpc_method_not_found, "there is no method \"" + name + "\"");
  if (params.is_array() && !params.empty())
    throw RpcError(rpc_invalid_params, "params must be an object of named values");
  const Json named = params.is_object() ? params : Json::object();
  const auto& [method, changes] = found->second;
  if (!changes) return method(named, caller);
  if (!caller.knows_token && !anybody_may_change_())
    throw RpcError(rpc_forbidden, name +
                                      " changes something: show the box's token first (auth), or "
                                      "press its button and ask again within 60 s");
  return change_once(name, method, named, caller);
}

/// A key is as good as a promise: what failed was not done, so its key is free.
JsonRpc::Json JsonRpc::change_once(const std::string& name, const Method& method,
                                   const Json& params, Caller& caller) {
  if (!params.contains("key")) return method(params, caller);
  const Json& key = params.at("key");
  if (!key.is_string() || key.get_ref<const std::string&>().empty() ||
      key.get_ref<const std::string&>().size() > longest_key)
    throw RpcError(rpc_invalid_params,
                   "key must be a string of 1 to " + std::to_string(longest_key) + " bytes");
  const Json request{{"method", name}, {"params", params}};
  const auto before = std::ranges::find(done_, key.get<std::string>(), &Done::key);
  if (before != done_.end() && before->request != request)
    throw RpcError(rpc_invalid_params, "this key was used for another request");
  if (before != done_.end()) return before->result;
  Json result = method(params, caller);
  if (done_.size() >= keys_remembered) done_.pop_front();
  done_.push_back({key.get<std::string>(), request, result});
  return result;
}

std::optional<JsonRpc::Json> JsonRpc::answer_one(const Json& request, Caller& caller) {
  if (const auto fault = fault_of(request)) {
    const bool has_id = request.is_object() && request.contains("id") && is_id(request.at("id"));
    return error(has_id ? request.at("id") : Json(nullptr), rpc_invalid_request, *fault);
  }
  const bool wants_answer = request.contains("id");
  const Json id = wants_answer ? request.at("id") : Json(nullptr);
  Json reply;
  try {
    const Json params = request.contains("params") ? request.at("params") : Json::object();
    reply = {{"jsonrpc", "2.0"},
             {"id", id},
             {"result", call(request.at("method").get<std::string>(), params, caller)}};
  } catch (const RpcError& refusal) {
    reply = error(id, refusal.code, refusal.what());
  } catch (const std::exception& fault) {
    reply = error(id, rpc_internal_error, fault.what());
  }
  return wants_answer ? std::optional(std::move(reply)) : std::nullopt;
}

std::optional<std::string> JsonRpc::answer(std::string_view line, Caller& caller) {
  const Json message = Json::parse(line, nullptr, false);
  if (message.is_discarded())
    return to_line(error(nullptr, rpc_parse_error, "not JSON; expected one object a line"));
  if (!message.is_array()) {
    const auto reply = answer_one(message, caller);
    return reply ? std::optional(to_line(*reply)) : std::nullopt;
  }
  if (message.empty() || message.size() > max_batch)
    return to_line(error(nullptr, rpc_invalid_request,
                         "a batch holds 1 to " + std::to_string(max_batch) + " requests"));
  Json replies = Json::array();
  for (const Json& request : message)
    if (auto reply = answer_one(request, caller)) replies.push_back(std::move(*reply));
  return replies.empty() ? std::nullopt : std::optional(to_line(replies));
}

}  // namespace throwcal
