// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/json_rpc.h"

#include "tests/fuzz/outside_text.h"

namespace {

using namespace throwcal;

/// Nothing that is sent may change anything: the caller has shown no token.
JsonRpc box(int& changes) {
  JsonRpc rpc;
  rpc.add("status.get", [](const JsonRpc::Json& params, JsonRpc::Caller&) { return params; });
  rpc.add("calibration.get", [](const JsonRpc::Json& params, JsonRpc::Caller&) {
    return params.at("id");  // throws what is none of ours
  });
  rpc.add_change("capture.start", [&](const JsonRpc::Json& params, JsonRpc::Caller&) {
    ++changes;
    return params;
  });
  return rpc;
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view line = text_of(data, size);
  if (line.find('\n') != line.npos || size > 64 * 1024) return 0;  // the link cuts lines
  int changes = 0;
  JsonRpc rpc = box(changes);
  JsonRpc::Caller stranger, friendly{.knows_token = true};
  const auto answer = rpc.answer(line, stranger);
  require(changes == 0, "a stranger changes nothing");
  require(!stranger.knows_token, "nobody gets the token by asking");
  (void)rpc.answer(line, friendly);
  if (!answer) return 0;
  require(answer->find('\n') == answer->npos, "an answer is one line");
  const JsonRpc::Json parsed = JsonRpc::Json::parse(*answer, nullptr, false);
  require(parsed.is_object() || parsed.is_array(), "an answer is JSON");
  const JsonRpc::Json first = parsed.is_array() ? parsed.at(0) : parsed;
  require(first.at("jsonrpc") == "2.0" && first.contains("id"), "an answer says whose it is");
  require(first.contains("result") != first.contains("error"), "it is a result or an error");
  return 0;
}
