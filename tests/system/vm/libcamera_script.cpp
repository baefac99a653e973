// SPDX-License-Identifier: BSD-3-Clause
// Preloaded into a program (LD_PRELOAD), makes a camera of libcamera's virtual pipeline, which has
// no pace and (in 0.4.0) leaves its buffers' metadata as memory was, one that follows the script in
// LIBCAMERA_SCRIPT, words of KEY=NUMBER: fps; first: its counter begins there; lose, damage: per
// cent; exposure_us: told with each frame. By the number of requests queued until then, once each:
// gone: says that it was unplugged; refuse: a request is refused; starve: none is filled until the
// next start. nostart: the start of that number fails. What it told is written to the file
// LIBCAMERA_LOG: a line a frame, "CAMERA SEQUENCE STATUS STAMP_NS".
#include <dlfcn.h>
#include <libcamera/libcamera.h>

#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <mutex>
#include <sstream>
#include <string>
#include <thread>

namespace {

using Clock = std::chrono::steady_clock;

struct Frame {
  libcamera::Request* request = nullptr;
  const libcamera::Camera* camera = nullptr;
  libcamera::FrameMetadata metadata;
  bool is_logged = false;
};
struct Feed {
  std::uint32_t sequence = 0, dice = 1;
  bool is_begun = false, is_starved = false;
  Clock::time_point due{};
};

std::recursive_mutex mutex;  // emit() comes back here
std::map<const libcamera::FrameBuffer*, Frame> frames;
std::map<const libcamera::Camera*, Feed> feeds;
int queued = 0, started = 0;

int said(const char* key) {
  static const auto script = [] {
    std::map<std::string, int> out;
    const char* text = std::getenv("LIBCAMERA_SCRIPT");
    std::istringstream words(text ? text : "");
    for (std::string word; words >> word;)
      out[word.substr(0, word.find('='))] = std::stoi(word.substr(word.find('=') + 1));
    return out;
  }();
  const auto found = script.find(key);
  return found == script.end() ? 0 : found->second;
}

std::FILE* log() {
  static std::FILE* const out = [] {
    const char* path = std::getenv("LIBCAMERA_LOG");
    return std::fopen(path ? path : "/dev/null", "w");
  }();
  return out;
}

bool happens(Feed& feed, int per_cent) {
  feed.dice = feed.dice * 1664525u + 1013904223u;
  return static_cast<int>((feed.dice >> 16) % 100) < per_cent;
}

/// dlsym() of a member function: its address is the first half of a pointer to it.
template <typename Member>
Member next(const char* symbol) {
  struct {
    void* address;
    std::ptrdiff_t adjustment;
  } const halves{dlsym(RTLD_NEXT, symbol), 0};
  Member out;
  static_assert(sizeof out == sizeof halves);
  __builtin_memcpy(&out, &halves, sizeof out);
  return out;
}

void wait_until_due(const libcamera::Camera* camera) {
  if (!said("fps")) return;
  Clock::time_point due;
  {
    const std::lock_guard lock(mutex);
    Feed& feed = feeds[camera];
    feed.due = std::max(feed.due + std::chrono::nanoseconds(1000000000 / said("fps")),
                        Clock::now() - std::chrono::milliseconds(100));
    due = feed.due;
  }
  std::this_thread::sleep_until(due);
}

}  // namespace

namespace libcamera {

int Camera::start(const ControlList* controls) {
  static const auto real =
      next<int (Camera::*)(const ControlList*)>("_ZN9libcamera6Camera5startEPKNS_11ControlListE");
  {
    const std::lock_guard lock(mutex);
    feeds[this].is_starved = false;
    if (++started == said("nostart")) return -EIO;
  }
  return (this->*real)(controls);
}

int Camera::queueRequest(Request* request) {
  static const auto real =
      next<int (Camera::*)(Request*)>("_ZN9libcamera6Camera12queueRequestEPNS_7RequestE");
  wait_until_due(this);
  const FrameBuffer* buffer = request->buffers().begin()->second;
  {
    const std::lock_guard lock(mutex);
    Feed& feed = feeds[this];
    if (++queued == said("refuse")) return -EIO;
    if (queued == said("starve")) feed.is_starved = true;
    if (feed.is_starved) return 0;
    if (!feed.is_begun) feed.sequence = static_cast<std::uint32_t>(said("first")) - 1;
    feed.is_begun = true;
    do ++feed.sequence;
    while (happens(feed, said("lose")));
    frames.erase(buffer);  // or its doctored answer is what is copied next
    Frame frame{request, this, buffer->metadata(), false};
    frame.metadata.sequence = feed.sequence;
    frame.metadata.status =
        happens(feed, said("damage")) ? FrameMetadata::FrameError : FrameMetadata::FrameSuccess;
    frames.insert_or_assign(buffer, std::move(frame));
  }
  const int result = (this->*real)(request);
  if (queued == said("gone")) disconnected.emit();
  return result;
}

const FrameMetadata& FrameBuffer::metadata() const {
  static const auto real =
      next<const FrameMetadata& (FrameBuffer::*)() const>("_ZNK9libcamera11FrameBuffer8metadataEv");
  const std::lock_guard lock(mutex);
  const auto found = frames.find(this);
  if (found == frames.end()) return (this->*real)();
  Frame& frame = found->second;
  if (frame.request->status() == Request::RequestComplete &&
      !std::exchange(frame.is_logged, true)) {
    ControlList& told = frame.request->metadata();
    if (said("exposure_us")) told.set(controls::ExposureTime, said("exposure_us"));
    std::fprintf(log(), "%s %u %d %lld\n", frame.camera->id().c_str(), frame.metadata.sequence,
                 frame.metadata.status,
                 static_cast<long long>(told.get(controls::SensorTimestamp).value_or(0)));
    std::fflush(log());
  }
  return frame.metadata;
}

}  // namespace libcamera
