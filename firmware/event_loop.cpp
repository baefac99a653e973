// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/event_loop.h"

#include <csignal>
#include <ctime>
#include <system_error>

namespace throwcal {

struct EventLoop::Callback : std::enable_shared_from_this<EventLoop::Callback> {
  std::function<void(std::uint32_t)> call;
};

namespace {

void check(int result, const char* what) {
  if (result < 0) throw std::system_error(-result, std::generic_category(), what);
}

int call_back(void* userdata, std::uint32_t events) {
  // Held for the call: it may end its own source.
  const auto held = static_cast<EventLoop::Callback*>(userdata)->shared_from_this();
  held->call(events);
  return 0;
}

int io_ready(sd_event_source*, int, std::uint32_t events, void* userdata) {
  return call_back(userdata, events);
}
int time_reached(sd_event_source*, std::uint64_t, void* userdata) { return call_back(userdata, 0); }
int signalled(sd_event_source*, const signalfd_siginfo*, void* userdata) {
  return call_back(userdata, 0);
}

auto without_events(std::function<void()> call) {
  return [call = std::move(call)](std::uint32_t) { call(); };
}

}  // namespace

void EventLoop::Source::Unref::operator()(sd_event_source* source) const {
  sd_event_source_disable_unref(source);
}

void EventLoop::Source::watch(std::uint32_t epoll_events) {
  check(sd_event_source_set_io_events(source_.get(), epoll_events),
        "sd_event_source_set_io_events");
}

void EventLoop::Source::after(std::chrono::microseconds delay) {
  check(sd_event_source_set_time_relative(source_.get(), static_cast<std::uint64_t>(delay.count())),
        "sd_event_source_set_time_relative");
  check(sd_event_source_set_enabled(source_.get(), SD_EVENT_ONESHOT),
        "sd_event_source_set_enabled");
}

EventLoop::EventLoop() {
  sd_event* event = nullptr;
  check(sd_event_new(&event), "sd_event_new");
  event_.reset(event);
}

EventLoop::Source EventLoop::source_for(std::function<void(std::uint32_t)> call,
                                        const Registration& add) {
  Source out;
  out.callback_ = std::make_shared<Callback>();
  out.callback_->call = std::move(call);
  sd_event_source* source = nullptr;
  check(add(&source, out.callback_.get()), "sd_event_add");
  out.source_.reset(source);
  return out;
}

EventLoop::Source EventLoop::on_io(int fd, std::uint32_t epoll_events,
                                   std::function<void(std::uint32_t)> call) {
  return source_for(std::move(call), [&](sd_event_source** source, void* userdata) {
    return sd_event_add_io(event_.get(), source, fd, epoll_events, io_ready, userdata);
  });
}

EventLoop::Source EventLoop::on_timer(std::chrono::microseconds delay, std::function<void()> call) {
  return source_for(without_events(std::move(call)), [&](sd_event_source** source, void* userdata) {
    constexpr std::uint64_t accuracy_us = 1000;
    return sd_event_add_time_relative(event_.get(), source, CLOCK_MONOTONIC,
                                      static_cast<std::uint64_t>(delay.count()), accuracy_us,
                                      time_reached, userdata);
  });
}

EventLoop::Source EventLoop::on_signal(int signal, std::function<void()> call) {
  return source_for(without_events(std::move(call)), [&](sd_event_source** source, void* userdata) {
    return sd_event_add_signal(event_.get(), source, signal, signalled, userdata);
  });
}

void EventLoop::run() { check(sd_event_loop(event_.get()), "sd_event_loop"); }

void EventLoop::quit() { check(sd_event_exit(event_.get(), 0), "sd_event_exit"); }

std::uint64_t EventLoop::turn() const {
  std::uint64_t turn = 0;
  check(sd_event_get_iteration(event_.get(), &turn), "sd_event_get_iteration");
  return turn;
}

}  // namespace throwcal
