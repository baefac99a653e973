// SPDX-License-Identifier: BSD-3-Clause
// USB cameras that exist only for the kernel, which believes in them and lets its uvcvideo drive
// them: it asks over USB/IP, through its virtual host controller (module vhci-hcd).
//
//   usb_camera MANUFACTURER,MODEL,SERIAL...
//
// plugs camera 0, 1, ... (without a serial number where SERIAL is empty) into port 0, 1, ...; each
// gives YUYV, 320x240 and 640x480, 30 and 15 a second, over a bulk endpoint. Standard input takes
// a command a line, and its end unplugs all:
//
//   plug N [PORT]    into the port of last time, or that; all controls have their defaults then
//   unplug N
//
// Standard output tells what was done: "plugged N PORT", "unplugged N".
//
// Luma of column x is exposure * gain / 25 * (0.5 + x / width) + brightness. In automatic modes
// exposure, focus and white balance wander with each frame, and can't be set.
#include <arpa/inet.h>
#include <linux/usb/ch9.h>
#include <linux/usb/video.h>
#include <linux/usbip.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <deque>
#include <fstream>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

namespace {

using Clock = std::chrono::steady_clock;
using Bytes = std::vector<std::uint8_t>;
using Answer = std::optional<Bytes>;  ///< nothing: the endpoint stalls

// ---- Little-endian bytes; a plain number is one of them.

struct Wide {
  unsigned value;
  int size;
};
Wide two(unsigned value) { return {value, 2}; }
Wide four(unsigned value) { return {value, 4}; }

void append(Bytes& out, Wide field) {
  for (int i = 0; i < field.size; ++i)
    out.push_back(static_cast<std::uint8_t>(field.value >> (8 * i)));
}
void append(Bytes& out, int field) { append(out, {static_cast<unsigned>(field), 1}); }
void append(Bytes& out, const Bytes& fields) {
  out.insert(out.end(), fields.begin(), fields.end());
}

template <typename... Fields>
Bytes bytes(const Fields&... fields) {
  Bytes out;
  (append(out, fields), ...);
  return out;
}

/// Its length, which comes first, is added.
template <typename... Fields>
Bytes descriptor(const Fields&... fields) {
  Bytes out = bytes(0, fields...);
  out[0] = static_cast<std::uint8_t>(out.size());
  return out;
}

int signed_number(const Bytes& data) {
  if (data.size() == 1) return data[0];
  if (data.size() == 2) return static_cast<std::int16_t>(data[0] | data[1] << 8);
  std::int32_t out = 0;
  std::memcpy(&out, data.data(), std::min(data.size(), sizeof out));
  return out;
}

// ---- Controls

constexpr int control_interface = 0, streaming_interface = 1;
constexpr int camera_terminal = 1, processing_unit = 2, output_terminal = 3;
constexpr int class_specific = USB_TYPE_CLASS | USB_DT_INTERFACE;

enum ControlIndex {
  ae_mode,
  ae_priority,
  exposure,
  focus,
  auto_focus,
  brightness,
  gain,
  white_balance,
  auto_white_balance,
  none
};

struct Control {
  int unit, selector, bit, size;  ///< bit of the unit's bmControls
  int least, most, step, usual;   ///< the automatic's least is "manual"
  ControlIndex automatic = none;
};
// The step of the mode is the set of its values: manual, aperture priority.
constexpr std::array<Control, none> controls{{
    {camera_terminal, UVC_CT_AE_MODE_CONTROL, 1, 1, 1, 8, 9, 8},
    {camera_terminal, UVC_CT_AE_PRIORITY_CONTROL, 2, 1, 0, 1, 1, 0},
    {camera_terminal, UVC_CT_EXPOSURE_TIME_ABSOLUTE_CONTROL, 3, 4, 1, 5000, 1, 156, ae_mode},
    {camera_terminal, UVC_CT_FOCUS_ABSOLUTE_CONTROL, 5, 2, 0, 250, 5, 0, auto_focus},
    {camera_terminal, UVC_CT_FOCUS_AUTO_CONTROL, 17, 1, 0, 1, 1, 1},
    {processing_unit, UVC_PU_BRIGHTNESS_CONTROL, 0, 2, -64, 64, 1, 0},
    {processing_unit, UVC_PU_GAIN_CONTROL, 9, 2, 1, 128, 1, 16},
    {processing_unit, UVC_PU_WHITE_BALANCE_TEMPERATURE_CONTROL, 6, 2, 2800, 6500, 10, 4600,
     auto_white_balance},
    {processing_unit, UVC_PU_WHITE_BALANCE_TEMPERATURE_AUTO_CONTROL, 12, 1, 0, 1, 1, 1},
}};

/// bmControls
Bytes control_bits(int unit, int size) {
  unsigned bits = 0;
  for (const Control& c : controls)
    if (c.unit == unit) bits |= 1u << c.bit;
  return bytes(size, Wide{bits, size});
}

class Controls {
 public:
  Controls() {
    for (const Control& c : controls) values_.push_back(c.usual);
  }
  int operator[](ControlIndex i) const { return values_[i]; }
  bool is_automatic(ControlIndex i) const {
    const ControlIndex automatic = controls[i].automatic;
    return automatic != none && values_[automatic] != controls[automatic].least;
  }
  void wander(int frame) {
    for (const ControlIndex i : {exposure, focus, white_balance})
      if (is_automatic(i)) values_[i] = controls[i].usual + controls[i].step * (1 + frame % 50);
  }
  Answer answer(const usb_ctrlrequest& asked, const Bytes& data) {
    const int unit = asked.wIndex >> 8, selector = asked.wValue >> 8;
    if (unit == 0 && selector == UVC_VC_REQUEST_ERROR_CODE_CONTROL) return bytes(error_);
    for (int i = 0; i < none; ++i)
      if (controls[i].unit == unit && controls[i].selector == selector)
        return asked.bRequest == UVC_SET_CUR ? set(static_cast<ControlIndex>(i), data)
                                             : get(static_cast<ControlIndex>(i), asked.bRequest);
    return refuse(invalid_control);
  }

 private:
  enum Error { wrong_state = 2, out_of_range = 4, invalid_control = 6, invalid_request = 7 };

  Answer refuse(Error why) {
    error_ = why;
    return std::nullopt;
  }
  Answer set(ControlIndex i, const Bytes& data) {
    const int value = signed_number(data);
    if (is_automatic(i)) return refuse(wrong_state);
    if (value < controls[i].least || value > controls[i].most) return refuse(out_of_range);
    values_[i] = value;
    return Bytes{};
  }
  Answer get(ControlIndex i, int what) {
    const Control& c = controls[i];
    const auto number = [&](int value) {
      return bytes(Wide{static_cast<unsigned>(value), c.size});
    };
    switch (what) {
      case UVC_GET_CUR:
        return number(values_[i]);
      case UVC_GET_MIN:
        return number(c.least);
      case UVC_GET_MAX:
        return number(c.most);
      case UVC_GET_RES:
        return number(c.step);
      case UVC_GET_DEF:
        return number(c.usual);
      case UVC_GET_LEN:
        return bytes(two(static_cast<unsigned>(c.size)));
      case UVC_GET_INFO:
        return bytes(UVC_CONTROL_CAP_GET | UVC_CONTROL_CAP_SET |
                     (c.automatic == none ? 0 : UVC_CONTROL_CAP_AUTOUPDATE));
      default:
        return refuse(invalid_request);
    }
  }

  std::vector<int> values_;
  int error_ = 0;
};

// ---- Pictures

constexpr int bulk_endpoint = 1, bulk_packet = 512;
constexpr unsigned most_payload = 32 * bulk_packet;  // what uvcvideo asks for at once, at most
constexpr std::array<unsigned, 2> intervals_100ns{333333, 666666};

struct Size {
  unsigned width, height;
  unsigned bytes() const { return 2 * width * height; }
};
constexpr std::array sizes{Size{320, 240}, Size{640, 480}};

/// What is agreed on, and the frames that then leave as payloads, one for each request. No frame is
/// ever left out: who asks late gets it late.
class Stream {
 public:
  Stream() { agree({}); }
  /// Probe and commit; the second begins.
  Answer answer(const usb_ctrlrequest& asked, const Bytes& data) {
    switch (asked.bRequest) {
      case UVC_SET_CUR:
        agree(data);
        if (asked.wValue >> 8 == UVC_VS_COMMIT_CONTROL) is_on_ = true, due_ = Clock::now();
        return Bytes{};
      case UVC_GET_INFO:
        return bytes(UVC_CONTROL_CAP_GET | UVC_CONTROL_CAP_SET);
      case UVC_GET_LEN:
        return bytes(two(sizeof agreed_));
      default: {
        const auto* const begin = reinterpret_cast<const std::uint8_t*>(&agreed_);
        return Bytes(begin, begin + sizeof agreed_);
      }
    }
  }
  void stop() { is_on_ = false, picture_.clear(), sent_ = 0; }
  /// When the next frame is exposed; nothing while one is being fetched.
  std::optional<Clock::time_point> due() const {
    return is_on_ && !has_data() ? std::optional(due_) : std::nullopt;
  }
  bool has_data() const { return sent_ < picture_.size(); }

  void expose(Controls& state) {
    state.wander(frame_++);
    draw(state);
    sent_ = 0;
    const bool is_slow = state.is_automatic(exposure) && state[ae_priority] == 1;
    due_ += (is_slow ? 2 : 1) * std::chrono::nanoseconds(100) * agreed_.dwFrameInterval;
    due_ = std::max(due_, Clock::now());
  }
  Bytes payload(std::size_t most) {
    constexpr std::size_t header = 6;
    const std::size_t size =
        std::min({most, std::size_t{most_payload}, header + picture_.size() - sent_}) - header;
    const bool is_last = sent_ + size == picture_.size();
    const int flags = UVC_STREAM_EOH | UVC_STREAM_PTS | (is_last ? UVC_STREAM_EOF : 0) | frame_ % 2;
    Bytes out = bytes(int{header}, flags, four(frame_ * agreed_.dwFrameInterval));
    out.insert(out.end(), &picture_[sent_], &picture_[sent_] + size);
    sent_ += size;
    return out;
  }

 private:
  void agree(const Bytes& asked) {
    std::memcpy(&agreed_, asked.data(), std::min(asked.size(), sizeof agreed_));
    agreed_.bFormatIndex = 1;
    agreed_.bFrameIndex = std::clamp<__u8>(agreed_.bFrameIndex, 1, sizes.size());
    agreed_.dwFrameInterval =
        agreed_.dwFrameInterval <= intervals_100ns[0] ? intervals_100ns[0] : intervals_100ns[1];
    agreed_.dwMaxVideoFrameSize = size().bytes();
    agreed_.dwMaxPayloadTransferSize = most_payload;
    agreed_.dwClockFrequency = 10'000'000;
  }
  Size size() const { return sizes[agreed_.bFrameIndex - 1u]; }

  void draw(const Controls& state) {
    const double level = state[exposure] * state[gain] / 25.0;
    const int tint = (state[white_balance] - 4600) / 50;
    Bytes line;
    for (unsigned x = 0; x < size().width; ++x) {
      const double luma = level * (0.5 + double(x) / size().width) + state[brightness];
      line.push_back(static_cast<std::uint8_t>(std::clamp(luma, 0.0, 255.0)));
      line.push_back(static_cast<std::uint8_t>(128 + (x % 2 ? tint : -tint)));
    }
    picture_.clear();
    for (unsigned y = 0; y < size().height; ++y) append(picture_, line);
  }

  uvc_streaming_control agreed_{};
  bool is_on_ = false;
  Clock::time_point due_;
  unsigned frame_ = 0;
  Bytes picture_;
  std::size_t sent_ = 0;
};

// ---- Descriptors

using Identity = std::array<std::string, 3>;  ///< manufacturer, model, serial number

Bytes device_descriptor(const Identity& identity) {
  return descriptor(USB_DT_DEVICE, two(0x0200), USB_CLASS_MISC, 2, 1, 64, two(0x1209), two(0x0001),
                    two(0x0100), 1, 2, identity[2].empty() ? 0 : 3, 1);
}

Answer string_descriptor(const Identity& identity, int index) {
  if (index == 0) return descriptor(USB_DT_STRING, two(0x0409));
  if (index > 3) return std::nullopt;
  Bytes text;
  for (const char c : identity[static_cast<std::size_t>(index - 1)])
    append(text, two(static_cast<unsigned char>(c)));
  return descriptor(USB_DT_STRING, text);
}

Bytes interface_descriptor(int number, int endpoints, int subclass) {
  return descriptor(USB_DT_INTERFACE, number, 0, endpoints, USB_CLASS_VIDEO, subclass,
                    UVC_PC_PROTOCOL_UNDEFINED, 0);
}

Bytes control_descriptors() {
  const Bytes units =
      bytes(descriptor(class_specific, UVC_VC_INPUT_TERMINAL, camera_terminal, two(UVC_ITT_CAMERA),
                       0, 0, two(0), two(0), two(0), control_bits(camera_terminal, 3)),
            descriptor(class_specific, UVC_VC_PROCESSING_UNIT, processing_unit, camera_terminal,
                       two(0), control_bits(processing_unit, 2), 0, 0),
            descriptor(class_specific, UVC_VC_OUTPUT_TERMINAL, output_terminal,
                       two(UVC_TT_STREAMING), 0, processing_unit, 0));
  const auto total = static_cast<unsigned>(UVC_DT_HEADER_SIZE(1) + units.size());
  return bytes(interface_descriptor(control_interface, 0, UVC_SC_VIDEOCONTROL),
               descriptor(class_specific, UVC_VC_HEADER, two(0x0110), two(total), four(10'000'000),
                          1, streaming_interface),
               units);
}

Bytes frame_descriptor(int index, Size size) {
  const unsigned bits = 8 * size.bytes();
  return descriptor(class_specific, UVC_VS_FRAME_UNCOMPRESSED, index, 0, two(size.width),
                    two(size.height), four(15 * bits), four(30 * bits), four(size.bytes()),
                    four(intervals_100ns[0]), int{intervals_100ns.size()}, four(intervals_100ns[0]),
                    four(intervals_100ns[1]));
}

Bytes streaming_descriptors() {
  const Bytes yuy2{'Y', 'U', 'Y', '2', 0, 0, 0x10, 0, 0x80, 0, 0, 0xaa, 0, 0x38, 0x9b, 0x71};
  const Bytes formats = bytes(descriptor(class_specific, UVC_VS_FORMAT_UNCOMPRESSED, 1,
                                         int{sizes.size()}, yuy2, 16, 1, 0, 0, 0, 0),
                              frame_descriptor(1, sizes[0]), frame_descriptor(2, sizes[1]));
  const auto total = static_cast<unsigned>(UVC_DT_INPUT_HEADER_SIZE(1, 1) + formats.size());
  return bytes(interface_descriptor(streaming_interface, 1, UVC_SC_VIDEOSTREAMING),
               descriptor(class_specific, UVC_VS_INPUT_HEADER, 1, two(total),
                          USB_DIR_IN | bulk_endpoint, 0, output_terminal, 0, 0, 0, 1, 0),
               formats,
               descriptor(USB_DT_ENDPOINT, USB_DIR_IN | bulk_endpoint, USB_ENDPOINT_XFER_BULK,
                          two(bulk_packet), 0));
}

Bytes configuration_descriptor() {
  const Bytes interfaces =
      bytes(descriptor(USB_DT_INTERFACE_ASSOCIATION, control_interface, 2, USB_CLASS_VIDEO,
                       UVC_SC_VIDEO_INTERFACE_COLLECTION, UVC_PC_PROTOCOL_UNDEFINED, 0),
            control_descriptors(), streaming_descriptors());
  const auto total = static_cast<unsigned>(USB_DT_CONFIG_SIZE + interfaces.size());
  return bytes(descriptor(USB_DT_CONFIG, two(total), 2, 1, 0, USB_CONFIG_ATT_ONE, 250), interfaces);
}

// ---- USB/IP: 48 bytes of big-endian numbers, then data.

constexpr std::uint32_t cmd_submit = 1, cmd_unlink = 2, ret_submit = 3, ret_unlink = 4;

struct Message {
  std::uint32_t command, number, device, is_in, endpoint;
  std::uint32_t flags, length, start_frame, packets, interval;  ///< of cmd_submit
  usb_ctrlrequest asked;                                        ///< is little-endian
};
static_assert(sizeof(Message) == 48);

const std::string controller = "/sys/devices/platform/vhci_hcd.0/";

void tell_controller(const std::string& file, const std::string& text) {
  std::ofstream out(controller + file);
  if (!(out << text << std::flush))
    throw std::system_error(errno, std::generic_category(), controller + file + ", " + text);
}

bool is_free(int port) {
  std::ifstream status(controller + "status");
  std::string hub;
  int number = 0, state = 0;
  for (std::string line; std::getline(status, line);)
    if (std::istringstream(line) >> hub >> number >> state && number == port)
      return state == VDEV_ST_NULL;
  throw std::runtime_error("the controller has no port " + std::to_string(port));
}

class Camera {
 public:
  Camera(int number, Identity identity)
      : number_(number), identity_(std::move(identity)), port_(number) {}

  int fd() const { return fd_; }
  /// A port may still be in use by a camera just unplugged: `go_on` plugs when it is free.
  void plug(int port) {
    unplug();
    port_ = port, is_wanted_ = true;
  }
  void plug() { plug(port_); }
  void unplug() {
    is_wanted_ = false;
    if (fd_ < 0) return;
    tell_controller("detach", std::to_string(port_));
    leave();
  }
  std::optional<Clock::time_point> due() const {
    if (is_wanted_) return Clock::now() + std::chrono::milliseconds(5);
    return stream_.due();
  }
  /// What time and earlier requests bring.
  void go_on() {
    if (is_wanted_ && is_free(port_)) attach();
    if (const auto due = stream_.due(); due && *due <= Clock::now()) stream_.expose(controls_);
    while (stream_.has_data() && !waiting_.empty()) {
      const Message request = waiting_.front();
      waiting_.pop_front();
      reply(request, stream_.payload(request.length));
    }
  }
  void receive() {
    Message message{};
    if (!read_whole(&message, sizeof message)) return leave();
    for (std::uint32_t* word = &message.command; word <= &message.interval; ++word)
      *word = ntohl(*word);
    if (message.command == cmd_unlink) return unlink(message);
    Bytes data(message.is_in ? 0 : message.length);
    if (!read_whole(data.data(), data.size())) return leave();
    if (message.endpoint == bulk_endpoint)
      waiting_.push_back(message);
    else
      reply(message, answer(message.asked, data));
  }

 private:
  void attach() {
    int ends[2];
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) < 0)
      throw std::system_error(errno, std::generic_category());
    fd_ = ends[0];
    tell_controller("attach", std::to_string(port_) + ' ' + std::to_string(ends[1]) + ' ' +
                                  std::to_string(number_ + 1) + ' ' +
                                  std::to_string(USB_SPEED_HIGH));
    close(ends[1]);
    is_wanted_ = false;
    std::printf("plugged %d %d\n", number_, port_);
  }
  void leave() {
    close(std::exchange(fd_, -1));
    controls_ = {}, stream_ = {}, waiting_.clear();
    std::printf("unplugged %d\n", number_);
  }
  bool read_whole(void* out, std::size_t size) {
    return size == 0 || recv(fd_, out, size, MSG_WAITALL) == static_cast<ssize_t>(size);
  }
  /// The kernel reads always. A connection that it closed is noticed when it is read.
  void send_whole(const Bytes& data) {
    for (std::size_t sent = 0; sent < data.size();) {
      const ssize_t n = send(fd_, &data[sent], data.size() - sent, MSG_NOSIGNAL);
      if (n <= 0) return;
      sent += static_cast<std::size_t>(n);
    }
  }
  void send_reply(std::uint32_t command, std::uint32_t number, int status, const Bytes& data,
                  std::uint32_t length) {
    std::array<std::uint32_t, 12> head{command, number, 0, 0, 0, static_cast<std::uint32_t>(status),
                                       length};
    for (std::uint32_t& word : head) word = htonl(word);
    const auto* const begin = reinterpret_cast<const std::uint8_t*>(head.data());
    Bytes out(begin, begin + sizeof head);
    append(out, data);
    send_whole(out);
  }
  void reply(const Message& request, Answer given) {
    if (!given) return send_reply(ret_submit, request.number, -EPIPE, {}, 0);
    if (!request.is_in) return send_reply(ret_submit, request.number, 0, {}, request.length);
    given->resize(std::min<std::size_t>(given->size(), request.length));
    send_reply(ret_submit, request.number, 0, *given, static_cast<std::uint32_t>(given->size()));
  }
  void unlink(const Message& message) {
    const auto victim = message.flags;
    const auto erased =
        std::erase_if(waiting_, [&](const Message& m) { return m.number == victim; });
    send_reply(ret_unlink, message.number, erased ? -ECONNRESET : 0, {}, 0);
  }

  Answer answer(const usb_ctrlrequest& asked, const Bytes& data) {
    if ((asked.bRequestType & USB_TYPE_MASK) == USB_TYPE_STANDARD) return standard_answer(asked);
    if ((asked.wIndex & 0xff) == streaming_interface) return stream_.answer(asked, data);
    return controls_.answer(asked, data);
  }
  Answer standard_answer(const usb_ctrlrequest& asked) {
    switch (asked.bRequest) {
      case USB_REQ_GET_DESCRIPTOR:
        return wanted_descriptor(asked.wValue >> 8, asked.wValue & 0xff);
      case USB_REQ_GET_STATUS:
        return bytes(two(0));
      case USB_REQ_CLEAR_FEATURE:  // of the endpoint, with which uvcvideo ends a stream
        if ((asked.bRequestType & USB_RECIP_MASK) == USB_RECIP_ENDPOINT) stream_.stop();
        return Bytes{};
      case USB_REQ_SET_CONFIGURATION:
      case USB_REQ_SET_INTERFACE:
        return Bytes{};
      default:
        return std::nullopt;
    }
  }
  Answer wanted_descriptor(int type, int index) const {
    switch (type) {
      case USB_DT_DEVICE:
        return device_descriptor(identity_);
      case USB_DT_CONFIG:
        return configuration_descriptor();
      case USB_DT_STRING:
        return string_descriptor(identity_, index);
      default:
        return std::nullopt;
    }
  }

  int number_;
  Identity identity_;
  int port_, fd_ = -1;
  bool is_wanted_ = false;
  Controls controls_;
  Stream stream_;
  std::deque<Message> waiting_;  ///< for a frame
};

// ---- Commands

void obey(std::deque<Camera>& cameras, const std::string& line) {
  std::istringstream words(line);
  std::string verb;
  std::size_t number = 0;
  if (!(words >> verb >> number) || number >= cameras.size() ||
      (verb != "plug" && verb != "unplug"))
    throw std::runtime_error("\"" + line + "\": expected plug N [PORT], or unplug N");
  int port = 0;
  if (verb == "unplug")
    cameras[number].unplug();
  else if (words >> port)
    cameras[number].plug(port);
  else
    cameras[number].plug();
}

/// False at the end of standard input.
bool read_commands(std::deque<Camera>& cameras, std::string& rest) {
  char text[256];
  const ssize_t n = read(STDIN_FILENO, text, sizeof text);
  if (n <= 0) return false;
  rest.append(text, static_cast<std::size_t>(n));
  for (std::size_t end; (end = rest.find('\n')) != std::string::npos; rest.erase(0, end + 1))
    obey(cameras, rest.substr(0, end));
  return true;
}

/// Until something comes or is due. What it returns belongs to standard input, then the cameras.
std::vector<pollfd> wait(const std::deque<Camera>& cameras) {
  std::vector<pollfd> files{{STDIN_FILENO, POLLIN, 0}};
  auto until = Clock::time_point::max();
  for (const Camera& camera : cameras) {
    files.push_back({camera.fd(), POLLIN, 0});
    until = std::min(until, camera.due().value_or(until));
  }
  const auto left = std::max<std::int64_t>((until - Clock::now()) / std::chrono::nanoseconds(1), 0);
  const timespec patience{left / 1'000'000'000, left % 1'000'000'000};
  ppoll(files.data(), files.size(), until == Clock::time_point::max() ? nullptr : &patience,
        nullptr);
  return files;
}

void run(std::deque<Camera>& cameras) {
  std::string rest;
  for (Camera& camera : cameras) camera.plug();
  while (true) {
    for (Camera& camera : cameras) camera.go_on();
    const std::vector<pollfd> files = wait(cameras);
    for (std::size_t i = 0; i < cameras.size(); ++i)
      if (files[i + 1].revents) cameras[i].receive();
    if (files[0].revents && !read_commands(cameras, rest)) return;
  }
}

Identity identity_of(const std::string& argument) {
  std::istringstream words(argument);
  Identity out;
  for (std::string& word : out) std::getline(words, word, ',');
  return out;
}

}  // namespace

int main(int argc, char** argv) {
  setvbuf(stdout, nullptr, _IOLBF, 0);
  std::deque<Camera> cameras;
  for (int i = 1; i < argc; ++i) cameras.emplace_back(i - 1, identity_of(argv[i]));
  try {
    run(cameras);
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "usb_camera: %s\n", error.what());
    return 1;
  }
}
