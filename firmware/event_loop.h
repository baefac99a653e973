// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <systemd/sd-event.h>

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>

namespace throwcal {

/// The main thread's loop (sd-event): whoever holds an EventSource is called back until it goes.
/// Throws std::system_error where the kernel refuses.
class EventLoop {
 public:
  struct Callback;
  /// A registration; ends with its owner. May end inside its own callback.
  class Source {
   public:
    Source() = default;
    Source(Source&&) noexcept = default;
    Source& operator=(Source&&) noexcept = default;
    void watch(std::uint32_t epoll_events);       ///< of an I/O source: which events from now on
    void after(std::chrono::microseconds delay);  ///< of a timer: call once more, so much later

   private:
    friend class EventLoop;
    struct Unref {
      void operator()(sd_event_source* source) const;
    };
    std::shared_ptr<Callback> callback_;  // outlives the source
    std::unique_ptr<sd_event_source, Unref> source_;
  };

  EventLoop();
  EventLoop(const EventLoop&) = delete;
  EventLoop& operator=(const EventLoop&) = delete;

  [[nodiscard]] Source on_io(int fd, std::uint32_t epoll_events,
                             std::function<void(std::uint32_t)> call);
  [[nodiscard]] Source on_timer(std::chrono::microseconds delay, std::function<void()> call);
  /// The signal must be blocked in every thread.
  [[nodiscard]] Source on_signal(int signal, std::function<void()> call);
  void run();   ///< until quit()
  void quit();  ///< ends run()
  /// The turn that it is in: one call of one source. Between two everybody else is heard.
  std::uint64_t turn() const;

 private:
  struct Unref {
    void operator()(sd_event* event) const { sd_event_unref(event); }
  };
  /// How one kind of source is added: an sd_event_add_...() call.
  using Registration = std::function<int(sd_event_source**, void* userdata)>;
  Source source_for(std::function<void(std::uint32_t)> call, const Registration& add);

  std::unique_ptr<sd_event, Unref> event_;
};

}  // namespace throwcal
