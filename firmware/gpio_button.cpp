// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/gpio_button.h"

#include <sys/epoll.h>

namespace throwcal {
namespace {

using namespace std::chrono_literals;

constexpr auto look_period = 1s;

}  // namespace

GpioButton::GpioButton(EventLoop& loop, Contacts& contacts, const GpioLineSettings& settings,
                       std::chrono::milliseconds debounce, const GpioKernel& kernel)
    : loop_(loop),
      contacts_(contacts),
      settings_(settings),
      debounce_(debounce),
      kernel_(kernel),
      look_again_(loop.on_timer(look_period, [this] { look(); })) {
  look();
}

void GpioButton::look() {
  if (line_) return;
  std::string why;
  line_ = GpioLine::input(settings_, debounce_, why, kernel_);
  const auto is_down = line_ ? line_->is_active() : std::nullopt;
  if (!is_down) {
    line_.reset();
    once_.warning("line", "button: " + why + "; it is waited for");
    look_again_.after(look_period);
    return;
  }
  once_.forget("line");
  contacts_.add(to_string(settings_), *is_down, line_->is_debounced());
  readable_ = loop_.on_io(line_->fd(), EPOLLIN, [this](std::uint32_t) { read_edges(); });
  log_info("button: " + to_string(settings_));
}

void GpioButton::read_edges() {
  if (!line_) return;
  const auto edges = line_->read_edges();
  if (!edges) return drop();
  for (const GpioLine::Edge& edge : *edges)
    contacts_.edge(to_string(settings_), edge.is_active, edge.at);
}

void GpioButton::drop() {
  contacts_.remove(to_string(settings_));
  log_warning("button: " + to_string(settings_) + " is gone");
  readable_ = {};
  line_.reset();
  look_again_.after(look_period);
}

}  // namespace throwcal
