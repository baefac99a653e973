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

JsonRpc counter(int& count, bool& anybody_may) {
  JsonRpc rpc([&] { return anybody_may; });
  rpc.add("read", [&](const Json&, JsonRpc::Caller&) { return Json(count); });
  rpc.add_change("count", [&](const Json&, JsonRpc::Caller&) {
    if (count < 0) throw RpcError(rpc_refused, "full");
    return Json(++count);
  });
  return rpc;
}

TEST(JsonRpc, ChangesNothingForWhoKnowsNoToken) {
  int count = 0;
  bool anybody_may = false;
  JsonRpc rpc = counter(count, anybody_may);
  JsonRpc::Caller stranger, friendly{.knows_token = true};
  EXPECT_EQ(rpc.call("read", {}, stranger), 0);
  for (const Json& params : {Json::object(), Json{{"key", "a"}}}) try {
      rpc.call("count", params, stranger);
      ADD_FAILURE() << "it counted for a stranger";
    } catch (const RpcError& error) {
      EXPECT_EQ(error.code, rpc_forbidden);
      EXPECT_NE(std::string(error.what()).find("token"), std::string::npos) << error.what();
    }
  EXPECT_EQ(count, 0);
  EXPECT_EQ(rpc.call("count", {}, friendly), 1);
  anybody_may = true;  // somebody has pressed the button
  EXPECT_EQ(rpc.call("count", {}, stranger), 2);
  anybody_may = false;
  EXPECT_THROW(rpc.call("count", {}, stranger), RpcError);
}

TEST(JsonRpc, DoesOnceWhatIsAskedForTwiceWithOneKey) {
  int count = 0;
  bool anybody_may = false;
  JsonRpc rpc = counter(count, anybody_may);
  JsonRpc::Caller caller{.knows_token = true}, other{.knows_token = true}, stranger;
  const Json key{{"key", "abc"}};
  EXPECT_EQ(rpc.call("count", key, caller), 1);
  EXPECT_EQ(rpc.call("count", key, caller), 1);
  EXPECT_EQ(rpc.call("count", key, other), 1) << "a client that lost its connection asks again";
  EXPECT_THROW(rpc.call("count", key, stranger), RpcError);
  EXPECT_EQ(rpc.call("count", {{"key", "abd"}}, caller), 2);
  EXPECT_THROW(rpc.call("count", {{"key", "abc"}, {"more", 1}}, caller), RpcError)
      << "another request under the same key";
  for (const Json& bad : {Json(""), Json(7), Json(std::string(65, 'x'))})
    EXPECT_THROW(rpc.call("count", {{"key", bad}}, caller), RpcError) << bad;
  count = -1;
  EXPECT_THROW(rpc.call("count", {{"key", "later"}}, caller), RpcError);
  count = 2;
  EXPECT_EQ(rpc.call("count", {{"key", "later"}}, caller), 3) << "what failed may be tried again";
  for (int i = 0; i < 300; ++i) rpc.call("count", {{"key", std::to_string(i)}}, caller);
  const int before = count;
  EXPECT_EQ(rpc.call("count", {{"key", "299"}}, caller), before);
  EXPECT_EQ(rpc.call("count", {{"key", "0"}}, caller), before + 1) << "forgotten: 256 are kept";
}

}  // namespace
}  // namespace throwcal
