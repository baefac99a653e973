// SPDX-License-Identifier: BSD-3-Clause
#include "capture/libcamera_stream.h"

#include <libcamera/control_ids.h>
#include <linux/dma-buf.h>
#include <linux/videodev2.h>
#include <sys/ioctl.h>
#include <sys/mman.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <type_traits>
#include <utility>

#include "capture/libcamera_list.h"
#include "capture/live_camera.h"
#include "capture/quotation.h"

namespace throwcal {
namespace {

constexpr unsigned wanted_buffers = 8;

[[noreturn]] void fail(const std::string& camera, const char* what, int code) {
  throw DeviceError(camera + ": " + what + ": " + std::strerror(code), code);
}

/// Whether the planes of a buffer follow each other in one piece of memory.
bool is_one_piece(const std::vector<libcamera::FrameBuffer::Plane>& planes) {
  for (std::size_t i = 1; i < planes.size(); ++i)
    if (planes[i].fd.get() != planes[0].fd.get() ||
        planes[i].offset != planes[i - 1].offset + planes[i - 1].length)
      return false;
  return true;
}

void sync(int fd, std::uint64_t flags) {
  dma_buf_sync command{flags | DMA_BUF_SYNC_READ};
  while (ioctl(fd, DMA_BUF_IOCTL_SYNC, &command) != 0 && errno == EINTR) {
  }
}

/// By its bytes: 0.4.0's virtual pipeline leaves there what is no status at all.
bool is_status(const libcamera::FrameMetadata& metadata, libcamera::FrameMetadata::Status status) {
  return std::memcmp(&metadata.status, &status, sizeof status) == 0;
}

/// All that the camera offers in formats read here.
std::string offered_text(const libcamera::StreamFormats& formats) {
  std::string out;
  for (const libcamera::PixelFormat& format : formats.pixelformats())
    out += (out.empty() ? "" : ", ") + format.toString();
  return out;
}

/// `wish` is in the rig file's unit, the control in one of `unit` times that.
template <typename T>
void set(libcamera::ControlList& out, const libcamera::ControlInfoMap& has,
         const libcamera::Control<T>& control, const char* key, const std::optional<double>& wish,
         double unit) {
  if (!wish) return;
  const std::string place = std::string(key) + " = " + number_text(*wish) + ": ";
  if (!has.count(&control)) throw std::runtime_error(place + "the camera has no such control");
  const libcamera::ControlInfo& info = has.at(&control);
  const double least = unit * static_cast<double>(info.min().get<T>()),
               most = unit * static_cast<double>(info.max().get<T>());
  if (*wish < least || *wish > most)
    throw std::runtime_error(place + "the camera goes from " + number_text(least) + " to " +
                             number_text(most));
  const double value = *wish / unit;
  out.set(control, static_cast<T>(std::is_integral_v<T> ? std::round(value) : value));
}

}  // namespace

libcamera::ControlList control_list(const libcamera::ControlInfoMap& has,
                                    const DeviceWishes& wanted) {
  namespace controls = libcamera::controls;
  libcamera::ControlList out(controls::controls);
  if (wanted.frames_per_s > 0 && has.count(&controls::FrameDurationLimits)) {
    const libcamera::ControlInfo& info = has.at(&controls::FrameDurationLimits);
    const std::int64_t least = info.min().get<std::int64_t>(),
                       most = std::max(least, info.max().get<std::int64_t>());
    const std::int64_t us =
        std::clamp<std::int64_t>(std::llround(1e6 / wanted.frames_per_s), least, most);
    out.set(controls::FrameDurationLimits, libcamera::Span<const std::int64_t, 2>({us, us}));
  }
  const PictureWishes& picture = wanted.picture;
  if (picture.automatic) return out;
  if (has.count(&controls::AeEnable)) out.set(controls::AeEnable, false);
  if (has.count(&controls::AwbEnable)) out.set(controls::AwbEnable, false);
  if (has.count(&controls::AfMode)) out.set(controls::AfMode, controls::AfModeManual);
  set(out, has, controls::ExposureTime, "exposure_s", picture.exposure_s, 1e-6);
  set(out, has, controls::AnalogueGain, "gain", picture.gain, 1);
  set(out, has, controls::LensPosition, "focus", picture.focus, 1);
  set(out, has, controls::ColourTemperature, "white_balance_k", picture.white_balance_k, 1);
  return out;
}

MappedBuffer::MappedBuffer(const libcamera::FrameBuffer& buffer, bool first_plane,
                           const std::string& camera) {
  const auto& planes = buffer.planes();
  if (planes.empty() || (!first_plane && !is_one_piece(planes)))
    throw std::runtime_error(camera +
                             ": has its planes in several places, which is not read in "
                             "colour");
  const auto& last = first_plane ? planes.front() : planes.back();
  fd_ = planes.front().fd.get();
  length_ = std::size_t{last.offset} + last.length;
  address_ = mmap(nullptr, length_, PROT_READ, MAP_SHARED, fd_, 0);
  if (address_ == MAP_FAILED) fail(camera, "mmap", errno);
  bytes_ =
      std::span(static_cast<const std::uint8_t*>(address_), length_).subspan(planes.front().offset);
}

MappedBuffer::MappedBuffer(MappedBuffer&& other) noexcept
    : address_(std::exchange(other.address_, nullptr)),
      length_(other.length_),
      fd_(other.fd_),
      bytes_(other.bytes_) {}

MappedBuffer::~MappedBuffer() {
  if (address_) munmap(address_, length_);
}

void MappedBuffer::begin_reading() const { sync(fd_, DMA_BUF_SYNC_START); }
void MappedBuffer::end_reading() const { sync(fd_, DMA_BUF_SYNC_END); }

LibcameraStream::LibcameraStream(std::shared_ptr<libcamera::Camera> camera,
                                 const V4l2Request& wanted)
    : camera_(std::move(camera)) {
  const int acquired = camera_->acquire();
  if (acquired == -EBUSY) fail(camera_->id(), "is used by another", EBUSY);
  check(acquired, "acquire");
  lease_.camera = camera_;
  configure(wanted);
  try {
    controls_ = control_list(camera_->controls(), wanted.device);
  } catch (const std::runtime_error& error) {
    throw std::runtime_error(camera_->id() + ": " + error.what());
  }
  // What FrameDurationLimits asks for is what comes; who has no such control does as it likes.
  if (const auto limits_us = controls_.get(libcamera::controls::FrameDurationLimits))
    format_.frames_per_s = 1e6 / static_cast<double>((*limits_us)[0]);
  map();
  const auto counter = counter_;
  camera_->requestCompleted.connect(
      this, [counter](libcamera::Request* request) { counter->take_in(request); });
  camera_->disconnected.connect(this, [counter] { counter->close(); });
}

LibcameraStream::~LibcameraStream() {
  camera_->stop();  // of a camera that does not run, or is gone: nothing
  camera_->requestCompleted.disconnect(this);
  camera_->disconnected.disconnect(this);
}

void LibcameraStream::check(int result, const char* what) const {
  if (result < 0) fail(camera_->id(), what, -result);
}

void LibcameraStream::configure(const V4l2Request& wanted) {
  configuration_ = video_configuration(*camera_);
  if (!configuration_) throw std::runtime_error(camera_->id() + ": gives no video");
  libcamera::StreamConfiguration& stream = configuration_->at(0);
  const libcamera::StreamFormats formats = stream.formats();
  const std::vector<libcamera::PixelFormat> offered = formats.pixelformats();
  std::vector<std::uint32_t> read;
  std::ranges::transform(offered, std::back_inserter(read), read_fourcc);
  const std::uint32_t best = cheapest_format(read, wanted.colour, wanted.device.fourcc);
  if (!best)
    throw std::runtime_error(camera_->id() + ": gives " + offered_text(formats) + "; expected " +
                             expected_formats(wanted.device.fourcc));
  const libcamera::PixelFormat chosen = *std::ranges::find(offered, best, read_fourcc);
  stream.pixelFormat = chosen;
  if (wanted.width_px > 0)
    stream.size = {static_cast<unsigned>(wanted.width_px), static_cast<unsigned>(wanted.height_px)};
  stream.bufferCount = std::max(stream.bufferCount, wanted_buffers);
  const libcamera::Size asked = stream.size;
  const bool is_valid = configuration_->validate() != libcamera::CameraConfiguration::Invalid;
  if (!is_valid || stream.size != asked || read_fourcc(stream.pixelFormat) != best)
    throw std::runtime_error(camera_->id() + ": gives pictures of " + stream.toString() +
                             "; the rig says " + size_text(asked.width, asked.height) + "; in " +
                             fourcc_text(best) + " there are " + sizes_text(formats, chosen));
  check(camera_->configure(configuration_.get()), "configure");
  stream_ = stream.stream();
  format_.fourcc = best;
  format_.width_px = static_cast<int>(stream.size.width);
  format_.height_px = static_cast<int>(stream.size.height);
  format_.stride_bytes = stream.stride;
  // Luma comes first, whatever follows it.
  if (best == V4L2_PIX_FMT_NV12 && !wanted.colour) format_.fourcc = V4L2_PIX_FMT_GREY;
  format_.least_bytes = least_bytes(format_);
}

void LibcameraStream::map() {
  allocator_ = std::make_unique<libcamera::FrameBufferAllocator>(camera_);
  check(allocator_->allocate(stream_), "has no memory for buffers");
  const bool first_plane = format_.fourcc != V4L2_PIX_FMT_NV12;
  for (const auto& buffer : allocator_->buffers(stream_)) {
    const auto& mapped =
        pixels_.emplace(buffer.get(), MappedBuffer(*buffer, first_plane, camera_->id()));
    if (mapped.first->second.bytes().size() < format_.least_bytes)
      throw std::runtime_error(camera_->id() + ": has buffers smaller than its pictures");
    auto request = camera_->createRequest();
    if (!request) fail(camera_->id(), "createRequest", ENOMEM);
    check(request->addBuffer(stream_, buffer.get()), "addBuffer");
    requests_.push_back(std::move(request));
  }
  counter_->done.resize(requests_.size());
}

void LibcameraStream::start() {
  check(camera_->start(&controls_), "start");
  // Some pipelines follow only the controls that come with a request.
  requests_.front()->controls().merge(controls_);
  for (const auto& request : requests_) check(camera_->queueRequest(request.get()), "queueRequest");
}

void LibcameraStream::Counter::take_in(libcamera::Request* request) {
  if (request->status() == libcamera::Request::RequestCancelled) return;  // the stream ends
  const HostTime at = now();
  {
    const std::lock_guard lock(mutex);
    done[(first + count++) % done.size()] = {request, at};
  }
  ready.set();
}

void LibcameraStream::Counter::close() {
  is_gone = true;
  ready.set();
}

std::optional<LibcameraStream::Picture> LibcameraStream::take() {
  counter_->ready.clear();
  if (counter_->is_gone) fail(camera_->id(), "was unplugged", ENODEV);
  Done done;
  {
    Counter& counter = *counter_;
    const std::lock_guard lock(counter.mutex);
    if (counter.count == 0) return std::nullopt;
    done = counter.done[counter.first];
    counter.first = (counter.first + 1) % counter.done.size();
    if (--counter.count > 0) counter.ready.set();
  }
  const libcamera::FrameBuffer* buffer = done.request->findBuffer(stream_);
  const libcamera::FrameMetadata& metadata = buffer->metadata();
  Picture out;
  out.request = done.request, out.pixels = &pixels_.at(buffer), out.completed = done.at;
  out.sequence = metadata.sequence;
  out.bytes = out.pixels->bytes();
  std::size_t used = 0;
  for (const auto& plane : metadata.planes()) used += plane.bytesused;
  // A pipeline that does not say how much it wrote wrote a picture.
  if (used > 0) out.bytes = out.bytes.first(std::min(used, out.bytes.size()));
  out.is_damaged = is_status(metadata, libcamera::FrameMetadata::FrameError) ||
                   is_status(metadata, libcamera::FrameMetadata::FrameCancelled) ||
                   out.bytes.size() < format_.least_bytes;
  return out;
}

void LibcameraStream::give_back(const Picture& picture) {
  picture.request->reuse(libcamera::Request::ReuseBuffers);
  check(camera_->queueRequest(picture.request), "queueRequest");
}

}  // namespace throwcal
