// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include "firmware/contacts.h"
#include "firmware/gpio_lines.h"
#include "firmware/journal.h"

namespace throwcal {

/// A GPIO line as a contact. A chip that is missing is waited for.
class GpioButton {
 public:
  /// Borrows loop and contacts for its life.
  GpioButton(EventLoop& loop, Contacts& contacts, const GpioLineSettings& settings,
             std::chrono::milliseconds debounce, const GpioKernel& kernel = {});

  void read_edges();  ///< that wait already

 private:
  void look();
  void drop();

  EventLoop& loop_;
  Contacts& contacts_;
  GpioLineSettings settings_;
  std::chrono::milliseconds debounce_;
  GpioKernel kernel_;
  LogOnce once_;
  std::optional<GpioLine> line_;
  EventLoop::Source readable_, look_again_;
};

}  // namespace throwcal
