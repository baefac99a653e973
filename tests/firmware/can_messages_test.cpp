// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/can_messages.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <regex>
#include <sstream>

#include "firmware/text_file.h"

namespace throwcal {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();
constexpr double infinity = std::numeric_limits<double>::infinity();

TEST(CanMessages, LieWhereTheDatabaseSays) {
  CanStatus status;
  status.state = can_state_code("capturing");
  status.verdict = can_verdict_code("accepted");
  status.throws = 3;
  status.worst_sigma_position_m = 0.00123;
  status.sequence = 5;
  // state 2, verdict 1 << 4, sequence 5 << 10, throws 3 << 14, sigma 123 << 28, rotation unknown
  EXPECT_EQ(encode(status), (CanPayload{0x12, 0xD4, 0x00, 0xB0, 0x07, 0xF0, 0xFF, 0x0F}));
}

TEST(CanMessages, ComeBackToHalfACount) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> place(-52.4, 52.4),
      angle(-std::numbers::pi, std::numbers::pi);
  for (int i = 0; i < 1000; ++i) {
    CanPosition position;
    CanRotation rotation;
    for (auto& each : position.translation_m) each = place(random);
    for (auto& each : rotation.rotation_rad) each = angle(random);
    position.sequence = rotation.sequence = i % 16;
    const auto there = decode<CanPosition>(encode(position));
    const auto turned = decode<CanRotation>(encode(rotation));
    EXPECT_EQ(there.sequence, i % 16);
    EXPECT_FALSE(is_clamped(position) || is_clamped(rotation));
    for (std::size_t k = 0; k < 3; ++k) {
      EXPECT_NEAR(*there.translation_m[k], *position.translation_m[k], 0.5001e-4);
      EXPECT_NEAR(*turned.rotation_rad[k], *rotation.rotation_rad[k], 3.0001e-6);
    }
  }
}

TEST(CanMessages, HoldEveryFieldToItsEnds) {
  const CanHealth health{64, 63, 65534, 0, 16382, 8};
  const auto well = decode<CanHealth>(encode(health));
  EXPECT_EQ(well.cameras, 64);
  EXPECT_EQ(well.cameras_running, 63);
  EXPECT_EQ(well.frames_lost, 65534);
  EXPECT_EQ(well.frames_dropped, 0);
  EXPECT_EQ(well.can_frames_lost, 16382);
  EXPECT_EQ(well.cameras_clamped, 8);
  const auto beat = decode<CanHeartbeat>(encode(CanHeartbeat{0xABCDEF, 1, 2, 255, 7, true, 127}));
  EXPECT_EQ(beat.uptime_s, 0xABCDEFu);
  EXPECT_EQ(beat.minor, 255);
  EXPECT_TRUE(beat.fd);
  EXPECT_EQ(beat.alive, 127);
  const auto command = decode<CanCommand>(encode(CanCommand{4, 255, 65535, 0xDEADBEEF}));
  EXPECT_EQ(command.key, 0xDEADBEEFu);
  EXPECT_EQ(command.argument, 65535);
  const auto ack = decode<CanAck>(encode(CanAck{2, 9, CanOutcome::locked, 5, 0xFFFFFFFF}));
  EXPECT_EQ(ack.outcome, CanOutcome::locked);
  EXPECT_EQ(ack.session, 0xFFFFFFFFu);
  const auto result = decode<CanResult>(encode(CanResult{15, 0xFFFFFF, 0x12345678}));
  EXPECT_EQ(result.length, 0xFFFFFFu);
  EXPECT_EQ(result.crc32, 0x12345678u);
}

TEST(CanMessages, SayWhatIsNotKnown) {
  const auto status = decode<CanStatus>(encode(CanStatus{}));
  EXPECT_FALSE(status.throws || status.worst_sigma_position_m || status.worst_sigma_rotation_rad);
  CanPosition nowhere;
  nowhere.translation_m = {nan, infinity, std::nullopt};
  EXPECT_FALSE(is_clamped(nowhere));
  for (const auto& each : decode<CanPosition>(encode(nowhere)).translation_m) EXPECT_FALSE(each);
}

TEST(CanMessages, AreClampedWhereANumberDoesNotFitAndSaySo) {
  CanStatus status;
  status.worst_sigma_position_m = 0.65534;
  EXPECT_FALSE(decode<CanStatus>(encode(status)).clamped);
  status.worst_sigma_position_m = 0.7;
  EXPECT_TRUE(decode<CanStatus>(encode(status)).clamped);
  EXPECT_DOUBLE_EQ(*decode<CanStatus>(encode(status)).worst_sigma_position_m, 0.65534);
  status.worst_sigma_position_m = -1e-3;
  EXPECT_EQ(decode<CanStatus>(encode(status)).worst_sigma_position_m, 0.0);
  CanPosition far;
  far.translation_m = {1e9, -1e9, 52.43};
  const auto back = decode<CanPosition>(encode(far));
  EXPECT_DOUBLE_EQ(*back.translation_m[0], 52.4287);
  EXPECT_DOUBLE_EQ(*back.translation_m[1], -52.4287);
  EXPECT_TRUE(is_clamped(far));
  const CanHeartbeat old{0xFFFFFFFF, 1, 0, 1, 0, false, 0};
  EXPECT_EQ(decode<CanHeartbeat>(encode(old)).uptime_s, 0xFFFFFFu);
  EXPECT_EQ(decode<CanHealth>(encode(CanHealth{200, 1, 1e12, 0, 0, 99})).cameras, 127);
}

TEST(CanMessages, KnowTheWords) {
  for (const char* state :
       {"idle", "warming-up", "capturing", "throw-seen", "solving", "done", "fault"})
    EXPECT_EQ(can_state_word(can_state_code(state)), state);
  EXPECT_EQ(can_state_code("on holiday"), can_unknown);
  EXPECT_EQ(can_state_word(can_unknown), "unknown");
  EXPECT_EQ(can_verdict_code(""), 0);
  EXPECT_EQ(can_verdict_word(can_verdict_code("needs-more-throws")), "needs-more-throws");
  EXPECT_EQ(can_verdict_word(7), "unknown");
  EXPECT_EQ(to_string(static_cast<CanOutcome>(200)), "an unknown outcome");
}

TEST(CanMessages, HaveTwelveUnitsInElevenBits) {
  EXPECT_EQ(can_base_id(0), 0x680u);
  EXPECT_EQ(can_base_id(can_units - 1) + can_ids_a_unit - 1, 0x7FFu);
  EXPECT_EQ(can_camera + 3 * can_cameras, can_ids_a_unit);
}

/// throwcal.dbc as text: what stands between `BO_ ID NAME` and the next message.
class Database {
 public:
  std::vector<CanSignal> signals(std::uint32_t id, std::string& name) const {
    const std::string head = "\nBO_ " + std::to_string(id) + " ";
    const std::size_t begin = text_.find(head);
    if (begin == text_.npos) return {};
    const std::string body = text_.substr(begin + 1, text_.find("\n\n", begin) - begin);
    name = body.substr(head.size() - 1, body.find(':') - head.size() + 1);
    static const std::regex signal(R"( SG_ (\w+) : (\d+)\|(\d+)@1([+-]) \(([^,]+),0\))");
    std::vector<CanSignal> out;
    for (std::sregex_iterator i(body.begin(), body.end(), signal), end; i != end; ++i)
      out.push_back(
          {(*i)[1], std::stoi((*i)[2]), std::stoi((*i)[3]), (*i)[4] == "-", std::stod((*i)[5])});
    return out;
  }
  bool has(const std::string& line) const { return text_.find(line) != text_.npos; }
  std::size_t messages() const {
    std::size_t count = 0;
    for (std::size_t at = 0; (at = text_.find("\nBO_ ", at)) != text_.npos; ++at) ++count;
    return count;
  }

 private:
  std::string text_ = read_text_file("firmware/throwcal.dbc");
};

template <typename Message>
void expect_in_database(const Database& database, int offset, const std::string& name) {
  std::string found;
  const auto said = database.signals(can_base_id(0) + static_cast<std::uint32_t>(offset), found);
  EXPECT_EQ(found, name);
  const auto ours = can_signals<Message>();
  ASSERT_EQ(said.size(), ours.size()) << name;
  for (std::size_t i = 0; i < ours.size(); ++i) {
    EXPECT_EQ(said[i].name, ours[i].name);
    EXPECT_EQ(said[i].start, ours[i].start) << name << "." << ours[i].name;
    EXPECT_EQ(said[i].bits, ours[i].bits) << name << "." << ours[i].name;
    EXPECT_EQ(said[i].is_signed, ours[i].is_signed) << name << "." << ours[i].name;
    EXPECT_DOUBLE_EQ(said[i].scale, ours[i].scale) << name << "." << ours[i].name;
  }
  EXPECT_EQ(ours.back().start + ours.back().bits, 64) << name;
}

TEST(CanDatabase, IsTheCode) {
  const Database database;
  expect_in_database<CanStatus>(database, can_status, "Status");
  expect_in_database<CanHealth>(database, can_health, "Health");
  expect_in_database<CanHeartbeat>(database, can_heartbeat, "Heartbeat");
  expect_in_database<CanCommand>(database, can_command, "Command");
  expect_in_database<CanAck>(database, can_ack, "Ack");
  expect_in_database<CanResult>(database, can_result, "Result");
  for (int i = 0; i < can_cameras; ++i) {
    const std::string camera = "Camera" + std::to_string(i + 1);
    expect_in_database<CanPosition>(database, can_camera + 3 * i, camera + "_Position");
    expect_in_database<CanRotation>(database, can_camera + 3 * i + 1, camera + "_Rotation");
    expect_in_database<CanQuality>(database, can_camera + 3 * i + 2, camera + "_Quality");
  }
  EXPECT_EQ(database.messages(), std::size_t{can_ids_a_unit});
}

TEST(CanDatabase, HasTheWords) {
  const Database database;
  std::string states, verdicts, outcomes;
  for (int i = 0; i < 7; ++i) states += " " + std::to_string(i) + " \"" + can_state_word(i) + "\"";
  for (int i = 1; i < 5; ++i)
    verdicts += " " + std::to_string(i) + " \"" + can_verdict_word(i) + "\"";
  for (int i = 0; i < 8; ++i)
    outcomes += " " + std::to_string(i) + " \"" + to_string(static_cast<CanOutcome>(i)) + "\"";
  EXPECT_TRUE(database.has("VAL_ 1664 state" + states + " 15 \"unknown\" ;")) << states;
  EXPECT_TRUE(database.has("VAL_ 1664 verdict 0 \"none\"" + verdicts + " 7 \"unknown\" ;"));
  EXPECT_TRUE(database.has("VAL_ 1668 outcome" + outcomes + " ;")) << outcomes;
  EXPECT_TRUE(database.has("VAL_ 1668 state" + states + " 15 \"unknown\" ;"));
}

}  // namespace
}  // namespace throwcal
