// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cstring>

#include "firmware/can_document.h"
#include "firmware/can_messages.h"
#include "firmware/can_orders.h"
#include "firmware/crc32.h"
#include "tests/fuzz/outside_text.h"

namespace throwcal {
namespace {

using Json = JsonRpc::Json;

constexpr std::uint32_t key = 0xCAFEBABE;

template <typename Message>
void comes_back(const CanPayload& payload) {
  require(encode(decode<Message>(payload)) == payload, "what was decoded is encoded the same");
}

void every_message(const CanPayload& payload) {
  comes_back<CanStatus>(payload);
  comes_back<CanHealth>(payload);
  comes_back<CanHeartbeat>(payload);
  comes_back<CanCommand>(payload);
  comes_back<CanAck>(payload);
  comes_back<CanResult>(payload);
  comes_back<CanPosition>(payload);
  comes_back<CanRotation>(payload);
  comes_back<CanQuality>(payload);
  require(!can_state_word(decode<CanStatus>(payload).state).empty(), "a state has a word");
  can_verdict_word(decode<CanStatus>(payload).verdict);
  require(!to_string(decode<CanAck>(payload).outcome).empty(), "an outcome has a word");
}

/// Each frame its length in one byte, then so many bytes; a tenth of a second apart.
void commands(std::string_view bytes) {
  JsonRpc rpc;
  int changes = 0, sent = 0;
  rpc.add("status.get", [](const Json&, JsonRpc::Caller&) -> Json {
    return {{"state", "idle"}, {"session", nullptr}};
  });
  for (const char* method : {"capture.start", "capture.stop", "capture.abort"})
    rpc.add_change(method, [&](const Json&, JsonRpc::Caller& caller) -> Json {
      require(caller.knows_token, "nothing changes without the key");
      return ++changes;
    });
  CanOrders orders(rpc, key, [&](int block) {
    require(block >= 0 && block < 65536, "a block's number has 16 bits");
    ++sent;
    return CanOutcome::ok;
  });
  int with_key = 0;
  auto now = CanOrders::Clock::time_point(std::chrono::hours(1));
  constexpr int enough = 40;  // frames: the lock and what is remembered are reached by then
  for (int i = 0; i < enough && !bytes.empty(); ++i) {
    const std::size_t size =
        std::min<std::size_t>(static_cast<unsigned char>(bytes[0]) % 65, bytes.size() - 1);
    CanPayload payload{};
    std::copy_n(bytes.data() + 1, std::min(size, payload.size()), payload.begin());
    const auto command = decode<CanCommand>(payload);
    with_key += command.key == key;
    const auto* data = reinterpret_cast<const std::uint8_t*>(bytes.data() + 1);
    const CanAck ack = orders.answer(data, size, now);
    require(ack.order == command.order && ack.sequence == command.sequence,
            "an answer tells whose");
    require((size == 8) == (ack.outcome != CanOutcome::malformed), "a command has 8 bytes");
    now += std::chrono::milliseconds(100);
    bytes.remove_prefix(1 + size);
  }
  require(changes <= with_key, "nothing changes without the key");
}

/// Each block its length in two bytes, then so many bytes.
void document(std::string_view bytes) {
  CanDocumentReader reader;
  while (bytes.size() >= 2) {
    const std::size_t size = std::min<std::size_t>(
        static_cast<unsigned char>(bytes[0]) + 256u * static_cast<unsigned char>(bytes[1]),
        bytes.size() - 2);
    reader.add(bytes.substr(2, size));
    require(reader.text().size() <= can_document_bytes, "a document has its limit");
    require(reader.wanted() >= 0 && reader.wanted() < 65536, "a block's number has 16 bits");
    bytes.remove_prefix(2 + size);
  }
  if (!reader.is_complete()) return;
  CanDocument again{1, reader.text(), crc32(reader.text())};
  CanDocumentReader other;
  for (int i = 0; i < again.blocks(); ++i)
    require(other.add(again.block(i)) == CanDocumentReader::Outcome::taken, "blocks are taken");
  require(other.text() == reader.text(), "what was put together comes apart again");
}

}  // namespace
}  // namespace throwcal

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace throwcal;
  const std::string_view bytes = text_of(data, size);
  for (std::size_t at = 0; at + 8 <= size; at += 8) {
    CanPayload payload;
    std::memcpy(payload.data(), data + at, payload.size());
    every_message(payload);
  }
  commands(bytes);
  document(bytes);
  return 0;
}
