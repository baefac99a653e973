// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <chrono>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "capture/device_wishes.h"
#include "capture/v4l2_controls.h"
#include "capture/v4l2_device.h"
#include "estimator/time.h"

namespace throwcal {

/// What is wanted of a V4L2 camera.
struct V4l2Request {
  int width_px = 0, height_px = 0;  ///< 0x0: as the driver is set
  bool colour = false;              ///< prefer formats with chroma
  DeviceWishes device;
  PictureNumbers remembered{};  ///< of a camera that was here before
};

/// How the lines of a buffer follow each other.
enum class Fields { progressive, interlaced, alternate };

/// What the driver gives, after negotiation.
struct V4l2Format {
  std::uint32_t fourcc = 0;
  int width_px = 0, height_px = 0;                ///< of a buffer; `alternate`: a field's
  std::size_t stride_bytes = 0, least_bytes = 0;  ///< least: of a whole picture
  Fields fields = Fields::progressive;
  bool is_top_first = true;   ///< of two fields
  double frames_per_s = 0.0;  ///< 0: the driver does not say
};

std::string fourcc_text(std::uint32_t fourcc);
bool is_compressed(std::uint32_t fourcc);  ///< JPEG
/// Whether pictures of this format can be read here.
bool is_read_format(std::uint32_t fourcc);
/// Of those offered the one that costs us least, 0 where none serves. `only`: this one, or empty.
std::uint32_t cheapest_format(const std::vector<std::uint32_t>& offered, bool colour,
                              const std::string& only);
/// For the message where none does.
std::string expected_formats(const std::string& only);
/// What a whole picture has at least: drivers pad, and a compressed one has any size.
std::size_t least_bytes(const V4l2Format& format);

/// A V4L2 camera that streams into memory-mapped buffers, single- or multi-planar. One thread at a
/// time. Ends the stream when it dies.
class V4l2Stream {
 public:
  /// Opens the device and changes nothing in it. Throws DeviceError, or std::runtime_error where
  /// it is no camera.
  explicit V4l2Stream(const std::string& path);
  V4l2Stream(const V4l2Stream&) = delete;
  ~V4l2Stream();

  const CameraIdentity& identity() const { return identity_; }  ///< all but its mode
  /// Once: negotiates and maps the buffers. Throws DeviceError, or std::runtime_error with what was
  /// asked and what there is.
  void configure(const V4l2Request& request);
  void start();  ///< throws DeviceError
  V4l2Controls& controls() { return *controls_; }

  const V4l2Format& format() const { return format_; }
  int fd() const { return device_.fd(); }

  struct Buffer {
    std::uint32_t index = 0, sequence = 0, flags = 0;  ///< V4L2_BUF_FLAG_...
    bool is_bottom = false;                            ///< of alternate fields
    HostTime stamp{};                                  ///< as the driver gives it, whatever clock
    std::span<const std::uint8_t> bytes;
    bool is_damaged = false;  ///< the driver says so, or it is shorter than a picture
  };
  /// The oldest filled buffer, or nothing if none waits. Throws DeviceError.
  std::optional<Buffer> dequeue();
  void requeue(const Buffer& buffer);

 private:
  struct Mapping {
    void* address = nullptr;
    std::size_t length = 0;
  };
  void choose_input(const V4l2Request& request);
  void negotiate(const V4l2Request& request);
  void set_rate(const V4l2Request& request);
  void map_buffers();
  void unmap();

  V4l2Device device_;
  std::uint32_t type_ = 0;  ///< V4L2_BUF_TYPE_...
  CameraIdentity identity_;
  V4l2Format format_;
  std::optional<V4l2Controls> controls_;
  std::vector<Mapping> mappings_;
};

}  // namespace throwcal
