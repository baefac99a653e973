// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <libcamera/camera.h>
#include <libcamera/controls.h>
#include <libcamera/framebuffer_allocator.h>
#include <libcamera/request.h>

#include <atomic>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "capture/event_flag.h"
#include "capture/v4l2_stream.h"

namespace throwcal {

/// What a camera is told when it starts, in libcamera's words: its automatics off unless wanted, a
/// rate as near as it goes. Throws std::runtime_error: a number that it has not, or not so far.
libcamera::ControlList control_list(const libcamera::ControlInfoMap& has,
                                    const DeviceWishes& wanted);

/// The pixels of a libcamera buffer in our memory.
class MappedBuffer {
 public:
  /// `first_plane`: no more of it. Throws DeviceError.
  MappedBuffer(const libcamera::FrameBuffer& buffer, bool first_plane, const std::string& camera);
  MappedBuffer(MappedBuffer&& other) noexcept;
  MappedBuffer& operator=(MappedBuffer&&) = delete;
  ~MappedBuffer();

  /// To be called before the pixels are read and after: not every memory is coherent.
  void begin_reading() const;
  void end_reading() const;
  std::span<const std::uint8_t> bytes() const { return bytes_; }

 private:
  void* address_ = nullptr;
  std::size_t length_ = 0;
  int fd_ = -1;  ///< libcamera's
  std::span<const std::uint8_t> bytes_;
};

/// A libcamera camera that streams. Requests go round: queued here, filled on libcamera's thread,
/// taken and given back by one thread of ours. Ends the stream and releases the camera when it
/// dies.
class LibcameraStream {
 public:
  /// Acquires, configures and maps; format()'s frames_per_s is what was asked for, if it can be.
  /// Throws DeviceError, or std::runtime_error with what was asked and what there is. Of `wanted`,
  /// `input` and `standard` mean nothing here.
  LibcameraStream(std::shared_ptr<libcamera::Camera> camera, const V4l2Request& wanted);
  LibcameraStream(const LibcameraStream&) = delete;
  ~LibcameraStream();

  void start();  ///< throws DeviceError

  const V4l2Format& format() const { return format_; }
  int fd() const { return counter_->ready.fd(); }  ///< readable when take() has something to say

  struct Picture {
    libcamera::Request* request = nullptr;
    const MappedBuffer* pixels = nullptr;
    std::span<const std::uint8_t> bytes;  ///< of `pixels`, those that were written
    HostTime completed{};                 ///< when libcamera handed it over
    std::uint32_t sequence = 0;           ///< the driver's
    bool is_damaged = false;              ///< the pipeline says so, or it is shorter than a picture
  };
  /// The oldest filled one, or nothing if none waits. Throws DeviceError where the camera is gone.
  std::optional<Picture> take();
  void give_back(const Picture& picture);  ///< throws DeviceError

 private:
  void configure(const V4l2Request& wanted);
  void map();
  void check(int result, const char* what) const;

  /// Acquired as long as it lives.
  struct Lease {
    std::shared_ptr<libcamera::Camera> camera;
    ~Lease() {
      if (camera) camera->release();
    }
  };
  std::shared_ptr<libcamera::Camera> camera_;
  Lease lease_;
  std::unique_ptr<libcamera::CameraConfiguration> configuration_;
  libcamera::Stream* stream_ = nullptr;
  libcamera::ControlList controls_;
  V4l2Format format_;
  std::unique_ptr<libcamera::FrameBufferAllocator> allocator_;
  std::map<const libcamera::FrameBuffer*, MappedBuffer> pixels_;
  std::vector<std::unique_ptr<libcamera::Request>> requests_;

  struct Done {
    libcamera::Request* request;
    HostTime at;
  };
  /// Where libcamera's thread hands over what is done: it may be in the midst of that when the
  /// stream dies.
  struct Counter {
    void take_in(libcamera::Request* request);
    void close();

    std::mutex mutex;
    std::vector<Done> done;  ///< circular, one place a request: it cannot overflow
    std::size_t first = 0, count = 0;
    std::atomic<bool> is_gone = false;
    EventFlag ready;
  };
  std::shared_ptr<Counter> counter_ = std::make_shared<Counter>();
};

}  // namespace throwcal
