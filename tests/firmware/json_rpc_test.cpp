// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/json_rpc.h"

#include <gtest/gtest.h>

namespace throwcal {
namespace {

using Json = JsonRpc::Json;

JsonRpc sample() {
  JsonRpc rpc;
  rpc.add("echo", [](const Json& params, JsonRpc::Caller&) { return params; });
  rpc.add("refuse",
          [](const Json&, JsonRpc::Caller&) -> Json { throw RpcError(rpc_refused, "not now"); });
  rpc.add("break",
          [](const Json&, JsonRpc::Caller&) -> Json { throw std::runtime_error("disk on fire"); });
  return rpc;
}

std::string answer_to(const std::string& line) {
  JsonRpc::Caller caller;
  return sample().answer(line, caller).value_or("nothing");
}

std::string error(const std::string& id, int code, const std::string& message) {
  return R"({"jsonrpc":"2.0","id":)" + id + R"(,"error":{"code":)" + std::to_string(code) +
         R"(,"message":)" + Json(message).dump() + "}}";
}

TEST(JsonRpc, AnswersARequestUnderItsId) {
  EXPECT_EQ(answer_to(R"({"jsonrpc":"2.0","id":1,"method":"echo","params":{"a":1}})"),
            R"({"jsonrpc":"2.0","id":1,"result":{"a":1}})");
  EXPECT_EQ(answer_to(R"({"jsonrpc":"2.0","id":"x","method":"echo"})"),
            R"({"jsonrpc":"2.0","id":"x","result":{}})");
  EXPECT_EQ(answer_to(R"({"jsonrpc":"2.0","id":null,"method":"echo","params":[]})"),
            R"({"jsonrpc":"2.0","id":null,"result":{}})");
}

TEST(JsonRpc, GivesEachFaultItsCode) {
  const struct {
    std::string line, answer;
  } cases[] = {
      {"hello?", error("null", -32700, "not JSON; expected one object a line")},
      {"{\"jsonrpc\":\"2.0\",", error("null", -32700, "not JSON; expected one object a line")},
      {"\xff\xfe", error("null", -32700, "not JSON; expected one object a line")},
      {"7", error("null", -32600, "a request must be an object")},
      {R"({"id":1,"method":"echo"})", error("1", -32600, "jsonrpc must be \"2.0\"")},
      {R"({"jsonrpc":"2.0","id":1,"method":5})", error("1", -32600, "method must be a string")},
      {R"({"jsonrpc":"2.0","id":{},"method":"echo"})",
       error("null", -32600, "id must be a string, a number or null")},
      {R"({"jsonrpc":"2.0","id":1,"method":"echo","params":3})",
       error("1", -32600, "params must be an object or an array")},
      {R"({"jsonrpc":"2.0","id":1,"method":"ecco"})",
       error("1", -32601, "there is no method \"ecco\"")},
      {R"({"jsonrpc":"2.0","id":1,"method":"echo","params":[1]})",
       error("1", -32602, "params must be an object of named values")},
      {R"({"jsonrpc":"2.0","id":1,"method":"break"})", error("1", -32603, "disk on fire")},
      {R"({"jsonrpc":"2.0","id":1,"method":"refuse"})", error("1", -32000, "not now")},
  };
  for (const auto& [line, answer] : cases) EXPECT_EQ(answer_to(line), answer) << line;
}

TEST(JsonRpc, ANotificationGetsNoAnswerNotEvenAnError) {
  EXPECT_EQ(answer_to(R"({"jsonrpc":"2.0","method":"echo"})"), "nothing");
  EXPECT_EQ(answer_to(R"({"jsonrpc":"2.0","method":"no such"})"), "nothing");
  EXPECT_EQ(answer_to(R"({"jsonrpc":"2.0","method":"break"})"), "nothing");
}

TEST(JsonRpc, ABatchIsAnsweredByABatch) {
  EXPECT_EQ(
      answer_to(
          R"([{"jsonrpc":"2.0","id":1,"method":"echo"},{"jsonrpc":"2.0","method":"echo"},5])"),
      "[" + std::string(R"({"jsonrpc":"2.0","id":1,"result":{}},)") +
          error("null", -32600, "a request must be an object") + "]");
  EXPECT_EQ(answer_to(R"([{"jsonrpc":"2.0","method":"echo"}])"), "nothing");
  EXPECT_EQ(answer_to("[]"), error("null", -32600, "a batch holds 1 to 100 requests"));
  std::string many = "[0";
  for (int i = 0; i < 100; ++i) many += ",0";
  EXPECT_EQ(answer_to(many + "]"), error("null", -32600, "a batch holds 1 to 100 requests"));
}

TEST(JsonRpc, DeepNestingAndBrokenTextDoNoHarm) {
  const std::string deep(30000, '[');
  EXPECT_EQ(answer_to(deep), error("null", -32700, "not JSON; expected one object a line"));
  EXPECT_EQ(answer_to(deep + std::string(30000, ']')).substr(0, 30),
            R"([{"jsonrpc":"2.0","id":null,"e)");
  EXPECT_NO_THROW(JsonRpc::to_line(Json{{"text", "\xc3\x28"}}));
}

}  // namespace
}  // namespace throwcal
