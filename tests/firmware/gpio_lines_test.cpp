// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/gpio_lines.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <linux/gpio.h>
#include <unistd.h>

#include <cerrno>

#include "firmware/text_file.h"

namespace throwcal {
namespace {

using namespace std::chrono_literals;

/// A kernel that plays one line: a pipe in place of its events.
class PlayedLine : public testing::Test {
 protected:
  PlayedLine() {
    std::filesystem::create_directories(folder_);
    write_text_file(folder_ / "gpiochip0", "");
    kernel_.folder = folder_;
    kernel_.ioctl = [this](int, unsigned long request, void* argument) {
      return answer(request, argument);
    };
  }
  ~PlayedLine() override {
    if (events_ >= 0) close(events_);
    std::filesystem::remove_all(folder_);
  }

  int answer(unsigned long request, void* argument) {
    if (refusal_ != 0) {
      errno = refusal_;
      return -1;
    }
    if (request == GPIO_V2_LINE_GET_VALUES_IOCTL)
      static_cast<gpio_v2_line_values*>(argument)->bits = level_;
    if (request == GPIO_V2_LINE_SET_VALUES_IOCTL)
      level_ = static_cast<gpio_v2_line_values*>(argument)->bits;
    return request == GPIO_V2_GET_LINE_IOCTL
               ? give_line(*static_cast<gpio_v2_line_request*>(argument))
               : 0;
  }

  int give_line(gpio_v2_line_request& request) {
    requests_.push_back(request);
    if (!debounces_ && request.config.num_attrs > 0) {
      errno = EOPNOTSUPP;
      return -1;
    }
    int ends[2];
    EXPECT_EQ(pipe(ends), 0);
    request.fd = ends[0];
    events_ = ends[1];
    return 0;
  }

  void play(bool rises, std::uint64_t at_ns, std::uint32_t number) const {
    gpio_v2_line_event event{};
    event.id = rises ? GPIO_V2_LINE_EVENT_RISING_EDGE : GPIO_V2_LINE_EVENT_FALLING_EDGE;
    event.timestamp_ns = at_ns;
    event.line_seqno = number;
    ASSERT_EQ(write(events_, &event, sizeof event), static_cast<ssize_t>(sizeof event));
  }

  const std::filesystem::path folder_ =
      std::filesystem::path(testing::TempDir()) /
      (std::string("gpio") + testing::UnitTest::GetInstance()->current_test_info()->name());
  GpioKernel kernel_;
  int refusal_ = 0, events_ = -1;
  bool debounces_ = true;
  std::uint64_t level_ = 0;
  std::vector<gpio_v2_line_request> requests_;
  std::string why_;
};

TEST_F(PlayedLine, IsAskedForAsItIsWired) {
  const auto line = GpioLine::input({"gpiochip0", 17, true, Pull::up}, 30ms, why_, kernel_);
  ASSERT_TRUE(line) << why_;
  ASSERT_EQ(requests_.size(), 1u);
  const gpio_v2_line_request& asked = requests_[0];
  EXPECT_EQ(asked.offsets[0], 17u);
  EXPECT_EQ(asked.num_lines, 1u);
  EXPECT_STREQ(asked.consumer, "throwcald");
  EXPECT_EQ(asked.config.flags, GPIO_V2_LINE_FLAG_INPUT | GPIO_V2_LINE_FLAG_EDGE_RISING |
                                    GPIO_V2_LINE_FLAG_EDGE_FALLING | GPIO_V2_LINE_FLAG_ACTIVE_LOW |
                                    GPIO_V2_LINE_FLAG_BIAS_PULL_UP);
  ASSERT_EQ(asked.config.num_attrs, 1u);
  EXPECT_EQ(asked.config.attrs[0].attr.id,
            static_cast<std::uint32_t>(GPIO_V2_LINE_ATTR_ID_DEBOUNCE));
  EXPECT_EQ(asked.config.attrs[0].attr.debounce_period_us, 30'000u);
  EXPECT_EQ(asked.config.attrs[0].mask, 1u);
  EXPECT_TRUE(line->is_debounced());
}

TEST_F(PlayedLine, DoesWithoutTheKernelsDebouncing) {
  debounces_ = false;
  const auto line = GpioLine::input({"gpiochip0", 1, false, Pull::as_is}, 30ms, why_, kernel_);
  ASSERT_TRUE(line) << why_;
  EXPECT_FALSE(line->is_debounced());
  EXPECT_EQ(requests_.back().config.num_attrs, 0u);
}

TEST_F(PlayedLine, GivesEdgesWithTheirTimes) {
  auto line = GpioLine::input({"gpiochip0", 1, false, Pull::as_is}, 0ms, why_, kernel_);
  ASSERT_TRUE(line) << why_;
  ASSERT_TRUE(line->read_edges());
  EXPECT_TRUE(line->read_edges()->empty()) << "none waits";
  play(true, 5'000'000'001, 1);
  play(false, 5'300'000'000, 2);
  const auto edges = line->read_edges();
  ASSERT_TRUE(edges);
  ASSERT_EQ(edges->size(), 2u);
  EXPECT_TRUE((*edges)[0].is_active);
  EXPECT_EQ((*edges)[0].at.time_since_epoch(), 5'000'000'001ns);
  EXPECT_FALSE((*edges)[1].is_active);
}

TEST_F(PlayedLine, TellsTheStateWhereEdgesWereLost) {
  auto line = GpioLine::input({"gpiochip0", 1, false, Pull::as_is}, 0ms, why_, kernel_);
  ASSERT_TRUE(line) << why_;
  play(true, 1'000, 1);
  play(true, 3'000, 3);  // the second was lost, and so was the fourth
  level_ = 0;
  const auto edges = line->read_edges();
  ASSERT_TRUE(edges);
  ASSERT_EQ(edges->size(), 3u);
  EXPECT_FALSE(edges->back().is_active);
}

TEST_F(PlayedLine, SetsAnOutput) {
  auto line = GpioLine::output({"gpiochip0", 27, false, Pull::as_is}, why_, kernel_);
  ASSERT_TRUE(line) << why_;
  EXPECT_EQ(requests_[0].config.flags, GPIO_V2_LINE_FLAG_OUTPUT);
  EXPECT_TRUE(line->set(true));
  EXPECT_EQ(level_, 1u);
  EXPECT_TRUE(line->set(false));
  EXPECT_EQ(level_, 0u);
}

TEST_F(PlayedLine, SaysWhatIsWrong) {
  const auto why = [&](const GpioLineSettings& settings) {
    EXPECT_FALSE(GpioLine::input(settings, 30ms, why_, kernel_));
    return why_;
  };
  EXPECT_EQ(why({"gpiochip9", 4, false, Pull::as_is}), "gpiochip9:4: No such file or directory");
  refusal_ = EBUSY;
  EXPECT_EQ(why({"gpiochip0", 4, false, Pull::as_is}),
            "gpiochip0:4: another program or driver uses this line");
  refusal_ = EINVAL;
  EXPECT_EQ(why({"gpiochip0", 64000, false, Pull::as_is}),
            "gpiochip0:64000: the chip has no such line, or not as it is wired here");
  refusal_ = ENOTTY;
  EXPECT_EQ(why({"gpiochip0", 4, false, Pull::as_is}),
            "gpiochip0:4: this is no GPIO chip, or the kernel is older than 5.10");
}

TEST_F(PlayedLine, KnowsThatItsChipIsGone) {
  auto line = GpioLine::input({"gpiochip0", 1, false, Pull::as_is}, 0ms, why_, kernel_);
  ASSERT_TRUE(line) << why_;
  close(events_);
  events_ = -1;
  EXPECT_FALSE(line->read_edges());
  refusal_ = ENODEV;
  EXPECT_FALSE(line->is_active());
  EXPECT_FALSE(line->set(true));
}

}  // namespace
}  // namespace throwcal
