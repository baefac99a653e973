// SPDX-License-Identifier: BSD-3-Clause
// A USB video class camera (1.1) as it is to whom it is plugged into: requests and their answers,
// and frames of YUYV, 320x240 and 640x480, 30 and 15 a second, over a bulk endpoint.
//
// Luma of column x is exposure * gain / 25 * (0.5 + x / width) + brightness. In automatic modes
// exposure, focus and white balance wander with each frame, and can't be set.
#pragma once

#include <linux/usb/ch9.h>
#include <linux/usb/video.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace usb {

using Clock = std::chrono::steady_clock;
using Bytes = std::vector<std::uint8_t>;
using Answer = std::optional<Bytes>;  ///< nothing: the endpoint stalls

// ---- Little-endian bytes; a plain number is one of them.

struct Wide {
  unsigned value;
  int size;
};
inline Wide two(unsigned value) { return {value, 2}; }
inline Wide four(unsigned value) { return {value, 4}; }

inline void append(Bytes& out, Wide field) {
  for (int i = 0; i < field.size; ++i)
    out.push_back(static_cast<std::uint8_t>(field.value >> (8 * i)));
}
inline void append(Bytes& out, int field) { append(out, {static_cast<unsigned>(field), 1}); }
inline void append(Bytes& out, const Bytes& fields) {
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

template <typename Plain>
Bytes bytes_of(const Plain& plain) {
  const auto* const begin = reinterpret_cast<const std::uint8_t*>(&plain);
  return {begin, begin + sizeof plain};
}

inline int signed_number(const Bytes& data) {
  unsigned out = 0;
  for (std::size_t i = 0; i < data.size(); ++i) out |= static_cast<unsigned>(data[i]) << (8 * i);
  return data.size() == 2 ? static_cast<std::int16_t>(out) : static_cast<int>(out);
}

// ---- Controls

constexpr int control_interface = 0, streaming_interface = 1;
constexpr int camera_terminal = 1, processing_unit = 2, output_terminal = 3;
constexpr int can_get_and_set = UVC_CONTROL_CAP_GET | UVC_CONTROL_CAP_SET;
constexpr int class_specific = USB_TYPE_CLASS | USB_DT_INTERFACE;

constexpr std::size_t ae_mode = 0, ae_priority = 1, exposure = 2, focus = 3, auto_focus = 4,
                      brightness = 5, gain = 6, white_balance = 7, auto_white_balance = 8, none = 9;

struct Control {
  int unit, selector, bit, size;  ///< bit of the unit's bmControls
  int least, most, step, usual;   ///< the automatic's least is "manual"
  std::size_t automatic = none;
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
inline Bytes control_bits(int unit, int size) {
  unsigned bits = 0;
  for (const Control& c : controls)
    if (c.unit == unit) bits |= 1u << c.bit;
  return bytes(size, Wide{bits, size});
}

class Controls {
 public:
  Controls() {
    for (std::size_t i = 0; i < none; ++i) values_[i] = controls[i].usual;
  }
  int operator[](std::size_t i) const { return values_[i]; }
  bool is_automatic(std::size_t i) const {
    const std::size_t automatic = controls[i].automatic;
    return automatic != none && values_[automatic] != controls[automatic].least;
  }
  void wander(unsigned frame) {
    for (const std::size_t i : {exposure, focus, white_balance})
      if (is_automatic(i))
        values_[i] = controls[i].usual + controls[i].step * (1 + static_cast<int>(frame % 50));
  }
  Answer answer(const usb_ctrlrequest& asked, const Bytes& data) {
    const int unit = asked.wIndex >> 8, selector = asked.wValue >> 8;
    if (unit == 0 && selector == UVC_VC_REQUEST_ERROR_CODE_CONTROL) return bytes(error_);
    for (std::size_t i = 0; i < none; ++i)
      if (controls[i].unit == unit && controls[i].selector == selector)
        return asked.bRequest == UVC_SET_CUR ? set(i, data) : get(i, asked.bRequest);
    return refuse(invalid_control);
  }

 private:
  static constexpr int wrong_state = 2, out_of_range = 4, invalid_control = 6, invalid_request = 7;

  Answer refuse(int why) {
    error_ = why;
    return std::nullopt;
  }
  Answer set(std::size_t i, const Bytes& data) {
    const int value = signed_number(data);
    if (is_automatic(i)) return refuse(wrong_state);
    if (value < controls[i].least || value > controls[i].most) return refuse(out_of_range);
    values_[i] = value;
    return Bytes{};
  }
  Answer get(std::size_t i, int what) {
    const Control& c = controls[i];
    if (what < UVC_GET_CUR || what > UVC_GET_DEF) return refuse(invalid_request);
    if (what == UVC_GET_LEN) return bytes(two(static_cast<unsigned>(c.size)));
    if (what == UVC_GET_INFO)
      return bytes(can_get_and_set | (c.automatic == none ? 0 : UVC_CONTROL_CAP_AUTOUPDATE));
    const int numbers[]{values_[i], c.least, c.most, c.step, 0, 0, c.usual};
    return bytes(Wide{static_cast<unsigned>(numbers[what - UVC_GET_CUR]), c.size});
  }

  std::array<int, none> values_{};
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
    if (asked.bRequest == UVC_GET_INFO) return bytes(can_get_and_set);
    if (asked.bRequest == UVC_GET_LEN) return bytes(two(sizeof agreed_));
    if (asked.bRequest != UVC_SET_CUR) return bytes_of(agreed_);
    agree(data);
    if (asked.wValue >> 8 == UVC_VS_COMMIT_CONTROL) is_on_ = true, due_ = Clock::now();
    return Bytes{};
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
    std::copy_n(asked.begin(), std::min(asked.size(), sizeof agreed_),
                reinterpret_cast<std::uint8_t*>(&agreed_));
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

inline Bytes device_descriptor(const Identity& identity) {
  return descriptor(USB_DT_DEVICE, two(0x0200), USB_CLASS_MISC, 2, 1, 64, two(0x1209), two(0x0001),
                    two(0x0100), 1, 2, identity[2].empty() ? 0 : 3, 1);
}

inline Answer string_descriptor(const Identity& identity, int index) {
  if (index == 0) return descriptor(USB_DT_STRING, two(0x0409));
  if (index > 3) return std::nullopt;
  Bytes text;
  for (const char c : identity[static_cast<std::size_t>(index - 1)])
    append(text, two(static_cast<unsigned char>(c)));
  return descriptor(USB_DT_STRING, text);
}

inline Bytes interface_descriptor(int number, int endpoints, int subclass) {
  return descriptor(USB_DT_INTERFACE, number, 0, endpoints, USB_CLASS_VIDEO, subclass,
                    UVC_PC_PROTOCOL_UNDEFINED, 0);
}

inline Bytes control_descriptors() {
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

inline Bytes frame_descriptor(int index, Size size) {
  const unsigned bits = 8 * size.bytes();
  return descriptor(class_specific, UVC_VS_FRAME_UNCOMPRESSED, index, 0, two(size.width),
                    two(size.height), four(15 * bits), four(30 * bits), four(size.bytes()),
                    four(intervals_100ns[0]), int{intervals_100ns.size()}, four(intervals_100ns[0]),
                    four(intervals_100ns[1]));
}

inline Bytes streaming_descriptors() {
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

inline Bytes configuration_descriptor() {
  const Bytes interfaces =
      bytes(descriptor(USB_DT_INTERFACE_ASSOCIATION, control_interface, 2, USB_CLASS_VIDEO,
                       UVC_SC_VIDEO_INTERFACE_COLLECTION, UVC_PC_PROTOCOL_UNDEFINED, 2),
            control_descriptors(), streaming_descriptors());
  const auto total = static_cast<unsigned>(USB_DT_CONFIG_SIZE + interfaces.size());
  return bytes(descriptor(USB_DT_CONFIG, two(total), 2, 1, 0, USB_CONFIG_ATT_ONE, 250), interfaces);
}

inline Answer wanted_descriptor(const Identity& identity, int type, int index) {
  if (type == USB_DT_DEVICE) return device_descriptor(identity);
  if (type == USB_DT_CONFIG) return configuration_descriptor();
  return type == USB_DT_STRING ? string_descriptor(identity, index) : std::nullopt;
}

class UvcCamera {
 public:
  explicit UvcCamera(Identity identity) : identity_(std::move(identity)) {}

  void lose_power() { controls_ = {}, stream_ = {}; }

  Answer answer(const usb_ctrlrequest& asked, const Bytes& data) {
    if ((asked.bRequestType & USB_TYPE_MASK) == USB_TYPE_STANDARD) return standard_answer(asked);
    if ((asked.wIndex & 0xff) == streaming_interface) return stream_.answer(asked, data);
    return controls_.answer(asked, data);
  }
  /// When the next frame begins; nothing while there is data, or nobody wants frames.
  std::optional<Clock::time_point> due() const { return stream_.due(); }
  void expose() { stream_.expose(controls_); }
  bool has_data() const { return stream_.has_data(); }
  /// The answer to a request to the bulk endpoint, if there is data.
  Bytes payload(std::size_t most) { return stream_.payload(most); }

 private:
  Answer standard_answer(const usb_ctrlrequest& asked) {
    if (asked.bRequest == USB_REQ_GET_DESCRIPTOR)
      return wanted_descriptor(identity_, asked.wValue >> 8, asked.wValue & 0xff);
    if (asked.bRequest == USB_REQ_GET_STATUS) return bytes(two(0));
    // With it uvcvideo ends a stream of a bulk endpoint.
    if (asked.bRequest == USB_REQ_CLEAR_FEATURE && asked.bRequestType == USB_RECIP_ENDPOINT)
      stream_.stop();
    return Bytes{};
  }

  Identity identity_;
  Controls controls_;
  Stream stream_;
};

}  // namespace usb
