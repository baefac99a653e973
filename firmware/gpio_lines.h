// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "firmware/file_handle.h"
#include "firmware/panel_settings.h"

namespace throwcal {

/// How the kernel is asked, and where: another in tests.
struct GpioKernel {
  std::function<int(int fd, unsigned long request, void* argument)> ioctl;  ///< as ::ioctl()
  std::filesystem::path folder = "/dev";

  GpioKernel();
};

/// One line of a GPIO chip, by the character device's second interface (linux/gpio.h; kernel 5.10
/// and newer). libgpiod is not used: those of Debian 12 and 13 differ in every call.
class GpioLine {
 public:
  struct Edge {
    bool is_active;
    std::chrono::steady_clock::time_point at;
  };

  /// With the kernel's debouncing where it can, else without. Nothing where the chip is not there
  /// or the line is taken; `why` says it, with chip and line.
  static std::optional<GpioLine> input(const GpioLineSettings& settings,
                                       std::chrono::milliseconds debounce, std::string& why,
                                       const GpioKernel& kernel = {});
  /// Off at first.
  static std::optional<GpioLine> output(const GpioLineSettings& settings, std::string& why,
                                        const GpioKernel& kernel = {});

  int fd() const { return line_.get(); }  ///< of an input: readable while edges wait
  bool is_debounced() const { return is_debounced_; }
  std::optional<bool> is_active() const;  ///< nothing where the kernel says no: the chip is gone
  /// The edges that wait; where some were lost, one more that tells the state as it is. Nothing
  /// where the chip is gone.
  std::optional<std::vector<Edge>> read_edges();
  bool set(bool is_on);  ///< of an output; false: the chip is gone

 private:
  explicit GpioLine(const GpioKernel& kernel) : kernel_(kernel) {}
  static std::optional<GpioLine> request(const GpioLineSettings& settings, std::uint64_t flags,
                                         std::chrono::milliseconds debounce, std::string& why,
                                         const GpioKernel& kernel);

  GpioKernel kernel_;
  FileHandle line_;
  bool is_debounced_ = false;
  std::uint32_t edges_ = 0;  ///< the number of the last one
};

}  // namespace throwcal
