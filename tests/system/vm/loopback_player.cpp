// SPDX-License-Identifier: BSD-3-Clause
// Plays footage into v4l2loopback devices, in step, with chosen stamps:
//
//   loopback_player WIDTH HEIGHT FOURCC FPS[/FROM] DEVICE=RAWFILE[+NS]...
//
// A RAWFILE holds frames back to back, lines packed, of a format of one plane (GREY, YUYV, ...);
// all hold equally many. Frame k goes out at B + k / FPS of CLOCK_MONOTONIC, B being soon after
// the start, and carries that moment + NS as its stamp, in whole microseconds as V4L2 does. What
// was written is on standard output, after its writing: a line "DEVICE k STAMP_NS". With /FROM the
// frames from that on follow the last, again and again.
//
// v4l2loopback has no buffers of a reader's own: who is as many frames late as the reader asked
// buffers (8 at most) finds newer pixels under an older stamp.
#include <fcntl.h>
#include <linux/videodev2.h>
#include <sys/ioctl.h>
#include <sys/mman.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iostream>
#include <stdexcept>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

namespace {

/// A device's output, its buffers in turn, and the footage that goes there.
class Output {
 public:
  Output(const std::string& argument, uint32_t width, uint32_t height, const char* fourcc) {
    const size_t equals = argument.find('=');
    if (equals == std::string::npos) throw std::runtime_error(argument + ": no DEVICE=RAWFILE");
    const size_t plus = std::min(argument.find('+', equals), argument.size());
    device_ = argument.substr(0, equals);
    offset_ns_ = plus < argument.size() ? std::stoll(argument.substr(plus + 1)) : 0;

    fd_ = open(device_.c_str(), O_RDWR);
    if (fd_ < 0) fail("open");
    v4l2_format format{};
    format.type = V4L2_BUF_TYPE_VIDEO_OUTPUT;
    format.fmt.pix.width = width;
    format.fmt.pix.height = height;
    format.fmt.pix.pixelformat = v4l2_fourcc(fourcc[0], fourcc[1], fourcc[2], fourcc[3]);
    format.fmt.pix.field = V4L2_FIELD_NONE;
    const v4l2_pix_format asked = format.fmt.pix;
    call(VIDIOC_S_FMT, &format, "VIDIOC_S_FMT");
    const v4l2_pix_format& got = format.fmt.pix;
    if (got.width != asked.width || got.height != asked.height ||
        got.pixelformat != asked.pixelformat)
      throw std::runtime_error(device_ + ": does not take this format");
    frame_size_ = got.bytesperline * height;  // sizeimage may be whole memory pages

    std::ifstream file(argument.substr(equals + 1, plus - equals - 1), std::ios::binary);
    footage_.assign(std::istreambuf_iterator<char>(file), {});
    if (footage_.empty() || footage_.size() % frame_size_ != 0)
      throw std::runtime_error(argument + ": no whole frames of " + std::to_string(frame_size_) +
                               " bytes");
    start();
  }

  size_t frames() const { return footage_.size() / frame_size_; }

  void write(size_t frame, int64_t time_ns) {
    const int64_t stamp_us = (time_ns + offset_ns_) / 1000;
    v4l2_buffer buffer = empty_buffer(free_);
    std::memcpy(maps_[buffer.index], footage_.data() + frame * frame_size_, frame_size_);
    buffer.bytesused = frame_size_;
    buffer.field = V4L2_FIELD_NONE;
    buffer.flags = V4L2_BUF_FLAG_TIMESTAMP_COPY;
    buffer.timestamp = {stamp_us / 1'000'000, stamp_us % 1'000'000};
    call(VIDIOC_QBUF, &buffer, "VIDIOC_QBUF");
    call(VIDIOC_DQBUF, &buffer, "VIDIOC_DQBUF");
    free_ = buffer.index;
    std::cout << device_ << ' ' << frame << ' ' << stamp_us * 1000 << std::endl;
  }

 private:
  void start() {
    v4l2_requestbuffers request{};
    request.count = 8;  // which the driver shares with the readers
    request.type = V4L2_BUF_TYPE_VIDEO_OUTPUT;
    request.memory = V4L2_MEMORY_MMAP;
    call(VIDIOC_REQBUFS, &request, "VIDIOC_REQBUFS");
    for (uint32_t index = 0; index < request.count; ++index) {
      v4l2_buffer buffer = empty_buffer(index);
      call(VIDIOC_QUERYBUF, &buffer, "VIDIOC_QUERYBUF");
      void* map =
          mmap(nullptr, buffer.length, PROT_READ | PROT_WRITE, MAP_SHARED, fd_, buffer.m.offset);
      if (map == MAP_FAILED) fail("mmap");
      maps_.push_back(map);
    }
    int type = V4L2_BUF_TYPE_VIDEO_OUTPUT;
    call(VIDIOC_STREAMON, &type, "VIDIOC_STREAMON");
  }

  static v4l2_buffer empty_buffer(uint32_t index) {
    v4l2_buffer buffer{};
    buffer.index = index;
    buffer.type = V4L2_BUF_TYPE_VIDEO_OUTPUT;
    buffer.memory = V4L2_MEMORY_MMAP;
    return buffer;
  }

  void call(unsigned long request, void* argument, const char* name) {
    if (ioctl(fd_, request, argument) != 0) fail(name);
  }

  [[noreturn]] void fail(const char* what) const {
    throw std::system_error(errno, std::generic_category(), device_ + ": " + what);
  }

  std::string device_;
  int64_t offset_ns_ = 0;
  int fd_ = -1;
  uint32_t frame_size_ = 0;
  std::vector<char> footage_;
  std::vector<void*> maps_;
  uint32_t free_ = 0;
};

void play(int count, char** arguments) {
  if (count < 6 || std::strlen(arguments[3]) != 4)
    throw std::runtime_error(
        "usage: loopback_player WIDTH HEIGHT FOURCC FPS[/FROM] DEVICE=RAWFILE[+NS]...");
  const auto width = static_cast<uint32_t>(std::stoul(arguments[1]));
  const auto height = static_cast<uint32_t>(std::stoul(arguments[2]));
  size_t fps_end = 0;
  const std::string rate = arguments[4];
  const double fps = std::stod(rate, &fps_end);
  const bool repeats = fps_end < rate.size();
  std::vector<Output> outputs;
  for (int i = 5; i < count; ++i) outputs.emplace_back(arguments[i], width, height, arguments[3]);
  for (const Output& output : outputs)
    if (output.frames() != outputs.front().frames())
      throw std::runtime_error("the files differ in their number of frames");

  const size_t frames = outputs.front().frames();
  const size_t from = repeats ? std::stoul(rate.substr(fps_end + 1)) : 0;
  if (from >= frames) throw std::runtime_error("there is no frame " + std::to_string(from));

  using Clock = std::chrono::steady_clock;  // CLOCK_MONOTONIC
  const Clock::time_point begin = Clock::now() + std::chrono::milliseconds(100);
  for (size_t k = 0; k < frames || repeats; ++k) {
    const auto since_begin = std::chrono::duration<double>(static_cast<double>(k) / fps);
    const size_t frame = k < frames ? k : from + (k - frames) % (frames - from);
    const Clock::time_point due =
        begin + std::chrono::duration_cast<std::chrono::nanoseconds>(since_begin);
    std::this_thread::sleep_until(due);
    for (Output& output : outputs) output.write(frame, due.time_since_epoch().count());
  }
}

}  // namespace

int main(int count, char** arguments) {
  try {
    play(count, arguments);
  } catch (const std::exception& error) {
    std::cerr << "loopback_player: " << error.what() << '\n';
    return 1;
  }
}
