// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/can_bus.h"

#include <gtest/gtest.h>
#include <linux/can/error.h>

#include <cerrno>

namespace throwcal {
namespace {

CanSocket::Frame error_frame(std::uint32_t classes, std::uint8_t controller = 0) {
  CanSocket::Frame out;
  out.id = classes;
  out.is_error = true;
  out.size = 8;
  out.data[1] = controller;
  return out;
}

CanInterface off(CanCondition condition) { return {1, condition, "can0 is not well"}; }

class CanBusTest : public testing::Test {
 protected:
  CanBusTest() { bus_.opened(); }
  std::uint64_t count(const char* what) const { return bus_.to_json().at(what); }

  CanBus bus_{"can0"};
};

TEST(CanBus, IsMissingUntilItIsOpened) {
  CanBus bus("can0");
  EXPECT_EQ(bus.condition(), CanCondition::missing);
  EXPECT_EQ(bus.to_json().at("state"), "missing");
  bus.opened();
  EXPECT_EQ(bus.to_json().at("state"), "up");
  EXPECT_TRUE(bus.to_json().at("problem").is_null());
  EXPECT_EQ(bus.to_json().at("reopened"), 0);
}

TEST_F(CanBusTest, CountsWhatItCouldNotSend) {
  EXPECT_TRUE(bus_.sent(0));
  EXPECT_TRUE(bus_.sent(ENOBUFS));
  EXPECT_EQ(bus_.condition(), CanCondition::queue_full);
  EXPECT_TRUE(bus_.sent(EAGAIN));
  EXPECT_EQ(count("frames_sent"), 1u);
  EXPECT_EQ(count("frames_lost"), 2u);
  EXPECT_EQ(count("queue_full"), 2u);
  EXPECT_TRUE(bus_.sent(0));
  EXPECT_EQ(bus_.condition(), CanCondition::up) << "its queue has room again";
  testing::internal::CaptureStderr();
  bus_.sent(ENOBUFS);
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "") << "told once";
}

TEST_F(CanBusTest, IsGivenUpWhereTheInterfaceIsDown) {
  for (const int error : {ENETDOWN, ENXIO, ENODEV}) EXPECT_FALSE(bus_.sent(error)) << error;
  EXPECT_EQ(count("frames_lost"), 3u);
  EXPECT_EQ(count("queue_full"), 0u);
}

TEST_F(CanBusTest, CountsEachBusOffOnce) {
  EXPECT_FALSE(bus_.heard(error_frame(CAN_ERR_BUSOFF)));
  bus_.closed(off(CanCondition::bus_off));
  bus_.closed(off(CanCondition::bus_off));
  EXPECT_EQ(count("bus_off"), 1u);
  EXPECT_EQ(bus_.condition(), CanCondition::bus_off);
  bus_.opened();
  EXPECT_EQ(bus_.condition(), CanCondition::up);
  EXPECT_EQ(count("reopened"), 1u);
  bus_.closed(off(CanCondition::bus_off));
  EXPECT_EQ(count("bus_off"), 2u);
}

TEST_F(CanBusTest, TellsEachTimeThatItWentAndCameBackOnce) {
  testing::internal::CaptureStderr();
  for (int i = 0; i < 3; ++i) bus_.closed(off(CanCondition::down));
  bus_.opened();
  bus_.closed(off(CanCondition::down));
  const std::string said = testing::internal::GetCapturedStderr();
  EXPECT_EQ(said,
            "<4>CAN: can0 is not well; waiting for it\n<6>CAN: can0 is back\n"
            "<4>CAN: can0 is not well; waiting for it\n");
}

TEST_F(CanBusTest, IsErrorPassiveUntilItRecovers) {
  const auto passive = error_frame(CAN_ERR_CRTL, CAN_ERR_CRTL_TX_PASSIVE);
  EXPECT_TRUE(bus_.heard(passive));
  EXPECT_TRUE(bus_.heard(passive));
  EXPECT_EQ(bus_.condition(), CanCondition::error_passive);
  EXPECT_EQ(count("error_passive"), 1u);
  EXPECT_TRUE(bus_.heard(error_frame(CAN_ERR_CRTL, CAN_ERR_CRTL_ACTIVE)));
  EXPECT_EQ(bus_.condition(), CanCondition::up);
  EXPECT_TRUE(bus_.heard(error_frame(CAN_ERR_CRTL, CAN_ERR_CRTL_RX_PASSIVE)));
  EXPECT_TRUE(bus_.heard(error_frame(CAN_ERR_RESTARTED)));
  EXPECT_EQ(bus_.condition(), CanCondition::up);
  EXPECT_EQ(count("error_passive"), 2u);
}

TEST_F(CanBusTest, SurvivesAShortErrorFrame) {
  auto frame = error_frame(CAN_ERR_CRTL | CAN_ERR_TX_TIMEOUT, CAN_ERR_CRTL_TX_PASSIVE);
  frame.size = 0;
  EXPECT_TRUE(bus_.heard(frame));
  EXPECT_EQ(bus_.condition(), CanCondition::up);
  EXPECT_EQ(count("tx_timeouts"), 1u);
}

TEST(CanInterface, SaysWhatIsWrongWithIt) {
  const CanInterface missing = look_at_can("nocan7", false);
  EXPECT_EQ(missing.condition, CanCondition::missing);
  EXPECT_EQ(missing.problem, "there is no interface nocan7 (ip link lists them)");
  const CanInterface loopback = look_at_can("lo", false);
  EXPECT_EQ(loopback.condition, CanCondition::unusable);
  EXPECT_EQ(loopback.problem, "lo is no CAN interface");
}

}  // namespace
}  // namespace throwcal
