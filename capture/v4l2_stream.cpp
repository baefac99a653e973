// SPDX-License-Identifier: BSD-3-Clause
#include "capture/v4l2_stream.h"

#include <linux/videodev2.h>
#include <sys/mman.h>

#include <algorithm>
#include <array>
#include <cerrno>

namespace throwcal {
namespace {

constexpr std::uint32_t wanted_buffers = 8, fewest_buffers = 2;

/// What the pixels of a picture cost us, the cheapest first.
constexpr std::array grey_first{V4L2_PIX_FMT_GREY,   V4L2_PIX_FMT_NV12,   V4L2_PIX_FMT_YUYV,
                                V4L2_PIX_FMT_UYVY,   V4L2_PIX_FMT_SBGGR8, V4L2_PIX_FMT_SGBRG8,
                                V4L2_PIX_FMT_SGRBG8, V4L2_PIX_FMT_SRGGB8, V4L2_PIX_FMT_MJPEG,
                                V4L2_PIX_FMT_JPEG};
constexpr std::array colour_first{V4L2_PIX_FMT_NV12,   V4L2_PIX_FMT_YUYV,   V4L2_PIX_FMT_UYVY,
                                  V4L2_PIX_FMT_SBGGR8, V4L2_PIX_FMT_SGBRG8, V4L2_PIX_FMT_SGRBG8,
                                  V4L2_PIX_FMT_SRGGB8, V4L2_PIX_FMT_MJPEG,  V4L2_PIX_FMT_JPEG,
                                  V4L2_PIX_FMT_GREY};

bool is_multi_planar(std::uint32_t type) { return type == V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE; }

std::vector<std::uint32_t> offered_formats(const V4l2Device& device, std::uint32_t type) {
  std::vector<std::uint32_t> out;
  v4l2_fmtdesc entry{};
  for (entry.type = type; device.try_command(VIDIOC_ENUM_FMT, entry); ++entry.index)
    out.push_back(entry.pixelformat);
  return out;
}

/// A driver without the list, or with a continuous one, is asked by setting it.
std::string offered_sizes(const V4l2Device& device, std::uint32_t fourcc) {
  std::string out;
  v4l2_frmsizeenum entry{};
  entry.pixel_format = fourcc;
  for (; device.try_command(VIDIOC_ENUM_FRAMESIZES, entry); ++entry.index) {
    if (!out.empty()) out += ", ";
    if (entry.type == V4L2_FRMSIZE_TYPE_DISCRETE)
      out += size_text(entry.discrete.width, entry.discrete.height);
    else
      return size_text(entry.stepwise.min_width, entry.stepwise.min_height) + " to " +
             size_text(entry.stepwise.max_width, entry.stepwise.max_height);
  }
  return out;
}

std::uint32_t fourcc_of(std::string_view text) {
  std::array<char, 4> c{' ', ' ', ' ', ' '};
  std::copy_n(text.begin(), std::min<std::size_t>(4, text.size()), c.begin());
  return v4l2_fourcc(c[0], c[1], c[2], c[3]);
}

/// The line order of a buffer; nothing where it is one that is not split here.
std::optional<Fields> fields_of(std::uint32_t field) {
  switch (field) {
    case V4L2_FIELD_NONE:
    case V4L2_FIELD_ANY:
      return Fields::progressive;
    case V4L2_FIELD_INTERLACED:
    case V4L2_FIELD_INTERLACED_TB:
    case V4L2_FIELD_INTERLACED_BT:
      return Fields::interlaced;
    case V4L2_FIELD_ALTERNATE:
      return Fields::alternate;
    default:
      return std::nullopt;
  }
}

/// Pictures of 525 lines begin with the bottom field, those of 625 with the top one.
bool is_top_first(std::uint32_t field, v4l2_std_id standard) {
  if (field == V4L2_FIELD_INTERLACED_TB || field == V4L2_FIELD_INTERLACED_BT)
    return field == V4L2_FIELD_INTERLACED_TB;
  return !(standard & V4L2_STD_525_60);
}

}  // namespace

bool is_read_format(std::uint32_t fourcc) { return std::ranges::count(grey_first, fourcc) > 0; }

std::uint32_t cheapest_format(const std::vector<std::uint32_t>& offered, bool colour,
                              const std::string& only) {
  for (const std::uint32_t format : colour ? colour_first : grey_first)
    if (std::ranges::count(offered, format) && (only.empty() || format == fourcc_of(only)))
      return format;
  return 0;
}

std::string expected_formats(const std::string& only) {
  return only.empty() ? "GREY, NV12, YUYV, UYVY, Bayer of 8 bits, MJPG or JPEG" : only;
}

std::size_t least_bytes(const V4l2Format& format) {
  const std::size_t rows = static_cast<std::size_t>(format.height_px);
  if (is_compressed(format.fourcc)) return 1;
  return format.stride_bytes * (format.fourcc == V4L2_PIX_FMT_NV12 ? rows + rows / 2 : rows);
}

namespace {

/// What a driver makes of a wish.
struct Given {
  std::uint32_t width = 0, height = 0, fourcc = 0, field = 0, stride = 0;
};

/// Of 0x0, the size that the driver is set to.
Given ask(const V4l2Device& device, std::uint32_t type, const V4l2Request& request,
          std::uint32_t fourcc) {
  v4l2_format format{};
  format.type = type;
  device.command(VIDIOC_G_FMT, format, "VIDIOC_G_FMT");
  const auto wish = [&](auto& pix) {  // both kinds of planes begin alike
    if (request.width_px > 0) {
      pix.width = static_cast<std::uint32_t>(request.width_px);
      pix.height = static_cast<std::uint32_t>(request.height_px);
    }
    pix.pixelformat = fourcc;
    pix.field = V4L2_FIELD_ANY;
  };
  auto& planes = format.fmt.pix_mp;
  auto& plane = format.fmt.pix;
  if (is_multi_planar(type)) {
    wish(planes);
    planes.num_planes = 1;
    planes.plane_fmt[0] = {};
  } else {
    wish(plane);
    plane.bytesperline = plane.sizeimage = 0;
  }
  device.command(VIDIOC_S_FMT, format, "VIDIOC_S_FMT");
  if (is_multi_planar(type))
    return {planes.width, planes.height, planes.pixelformat, planes.field,
            planes.plane_fmt[0].bytesperline};
  return {plane.width, plane.height, plane.pixelformat, plane.field, plane.bytesperline};
}

}  // namespace

bool is_compressed(std::uint32_t fourcc) {
  return fourcc == V4L2_PIX_FMT_MJPEG || fourcc == V4L2_PIX_FMT_JPEG;
}

std::string fourcc_text(std::uint32_t fourcc) {
  std::string out;
  for (int i = 0; i < 4; ++i) out += static_cast<char>((fourcc >> (8 * i)) & 0x7f);
  while (!out.empty() && out.back() == ' ') out.pop_back();
  return out;
}

V4l2Stream::V4l2Stream(const std::string& path) : device_(path) {
  v4l2_capability has{};
  if (!device_.try_command(VIDIOC_QUERYCAP, has)) {
    if (errno == ENOTTY) throw DeviceError(path + ": is no V4L2 device", ENOTTY);
    device_.fail("VIDIOC_QUERYCAP");
  }
  identity_ = identity_of(device_, has);
  const std::uint32_t can =
      has.capabilities & V4L2_CAP_DEVICE_CAPS ? has.device_caps : has.capabilities;
  if (can & V4L2_CAP_VIDEO_CAPTURE)
    type_ = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  else if (can & V4L2_CAP_VIDEO_CAPTURE_MPLANE)
    type_ = V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE;
  if (!type_ || !(can & V4L2_CAP_STREAMING))
    throw std::runtime_error(path + ": is no camera that streams");
}

void V4l2Stream::configure(const V4l2Request& request) {
  choose_input(request);
  negotiate(request);
  set_rate(request);
  controls_.emplace(device_, request.device.picture, request.remembered);
  try {
    map_buffers();
  } catch (...) {
    unmap();
    throw;
  }
}

void V4l2Stream::start() {
  device_.command(VIDIOC_STREAMON, type_, "VIDIOC_STREAMON");
  controls_->set_again();
}

V4l2Stream::~V4l2Stream() {
  device_.try_command(VIDIOC_STREAMOFF, type_);  // of a device that is gone it fails: no matter
  unmap();
}

void V4l2Stream::choose_input(const V4l2Request& request) {
  if (!request.device.input.empty()) {
    std::string known;
    v4l2_input entry{};
    int found = -1;
    for (; device_.try_command(VIDIOC_ENUMINPUT, entry); ++entry.index) {
      const std::string name = text_of(entry.name, sizeof entry.name);
      known += (known.empty() ? "" : ", ") + std::to_string(entry.index) + " \"" + name + "\"";
      if (request.device.input == name || request.device.input == std::to_string(entry.index))
        found = static_cast<int>(entry.index);
    }
    if (found < 0)
      throw std::runtime_error(device_.path() + ": has no input \"" + request.device.input +
                               "\"; expected one of " + known);
    device_.command(VIDIOC_S_INPUT, found, "VIDIOC_S_INPUT");
  }
  if (!request.device.standard.empty()) {
    v4l2_std_id standard = request.device.standard == "PAL"    ? V4L2_STD_PAL
                           : request.device.standard == "NTSC" ? V4L2_STD_NTSC
                                                               : V4L2_STD_SECAM;
    device_.command(VIDIOC_S_STD, standard, "VIDIOC_S_STD");
  }
}

void V4l2Stream::negotiate(const V4l2Request& request) {
  const std::vector<std::uint32_t> offered = offered_formats(device_, type_);
  std::string names;
  for (const std::uint32_t f : offered) names += (names.empty() ? "" : ", ") + fourcc_text(f);
  const std::uint32_t best = cheapest_format(offered, request.colour, request.device.fourcc);
  if (!best)
    throw std::runtime_error(device_.path() + ": gives " + names + "; expected " +
                             expected_formats(request.device.fourcc));
  const Given given = ask(device_, type_, request, best);
  const auto fields = fields_of(given.field);
  const std::uint32_t lines = (fields == Fields::alternate ? 2 : 1) * given.height;
  const bool is_any_size = request.width_px == 0;
  const std::string wanted = size_text(static_cast<std::uint32_t>(request.width_px),
                                       static_cast<std::uint32_t>(request.height_px));
  if (!is_any_size && size_text(given.width, lines) != wanted)
    throw std::runtime_error(device_.path() + ": gives pictures of " +
                             size_text(given.width, lines) + "; the rig says " + wanted + "; in " +
                             fourcc_text(best) + " there are " + offered_sizes(device_, best));
  if (given.fourcc != best || !fields)
    throw std::runtime_error(device_.path() + ": asked for " + fourcc_text(best) + ", it gives " +
                             fourcc_text(given.fourcc) + ", field order " +
                             std::to_string(given.field) + ", which is not understood here");
  v4l2_std_id standard = 0;
  device_.try_command(VIDIOC_G_STD, standard);
  format_.fourcc = given.fourcc;
  format_.width_px = static_cast<int>(given.width);
  format_.height_px = static_cast<int>(given.height);
  format_.stride_bytes = given.stride;
  format_.fields = *fields;
  format_.is_top_first = is_top_first(given.field, standard);
  format_.least_bytes = least_bytes(format_);
}

void V4l2Stream::set_rate(const V4l2Request& request) {
  v4l2_streamparm parameters{};
  parameters.type = type_;
  if (!device_.try_command(VIDIOC_G_PARM, parameters)) return;
  v4l2_fract& interval = parameters.parm.capture.timeperframe;
  if (request.device.frames_per_s > 0 &&
      parameters.parm.capture.capability & V4L2_CAP_TIMEPERFRAME) {
    interval = {1000, static_cast<std::uint32_t>(1000 * request.device.frames_per_s + 0.5)};
    device_.command(VIDIOC_S_PARM, parameters, "VIDIOC_S_PARM");
  }
  if (interval.numerator > 0)
    format_.frames_per_s = static_cast<double>(interval.denominator) / interval.numerator;
}

void V4l2Stream::map_buffers() {
  v4l2_requestbuffers wanted{};
  wanted.count = wanted_buffers, wanted.type = type_, wanted.memory = V4L2_MEMORY_MMAP;
  device_.command(VIDIOC_REQBUFS, wanted, "VIDIOC_REQBUFS");
  if (wanted.count < fewest_buffers)
    throw std::runtime_error(device_.path() + ": has memory for " + std::to_string(wanted.count) +
                             " buffers; expected " + std::to_string(wanted_buffers));
  for (std::uint32_t i = 0; i < wanted.count; ++i) {
    v4l2_plane plane{};
    v4l2_buffer buffer{};
    buffer.type = type_, buffer.memory = V4L2_MEMORY_MMAP, buffer.index = i;
    if (is_multi_planar(type_)) buffer.m.planes = &plane, buffer.length = 1;
    device_.command(VIDIOC_QUERYBUF, buffer, "VIDIOC_QUERYBUF");
    const std::size_t length = is_multi_planar(type_) ? plane.length : buffer.length;
    const std::uint32_t offset = is_multi_planar(type_) ? plane.m.mem_offset : buffer.m.offset;
    void* address = mmap(nullptr, length, PROT_READ, MAP_SHARED, device_.fd(), offset);
    if (address == MAP_FAILED) device_.fail("mmap");
    mappings_.push_back({address, length});
    requeue({.index = i, .bytes = {}});
  }
}

void V4l2Stream::unmap() {
  for (const Mapping& mapping : mappings_) munmap(mapping.address, mapping.length);
  mappings_.clear();
}

std::optional<V4l2Stream::Buffer> V4l2Stream::dequeue() {
  v4l2_plane plane{};
  v4l2_buffer buffer{};
  buffer.type = type_, buffer.memory = V4L2_MEMORY_MMAP;
  if (is_multi_planar(type_)) buffer.m.planes = &plane, buffer.length = 1;
  if (!device_.try_command(VIDIOC_DQBUF, buffer)) {
    if (errno == EAGAIN) return std::nullopt;
    device_.fail("VIDIOC_DQBUF");
  }
  const std::size_t used = is_multi_planar(type_) ? plane.bytesused : buffer.bytesused;
  const Mapping& mapping = mappings_.at(buffer.index);
  Buffer out;
  out.index = buffer.index, out.sequence = buffer.sequence, out.flags = buffer.flags;
  out.is_bottom = buffer.field == V4L2_FIELD_BOTTOM;
  out.bytes = {static_cast<const std::uint8_t*>(mapping.address), std::min(used, mapping.length)};
  out.is_damaged = (buffer.flags & V4L2_BUF_FLAG_ERROR) || used < format_.least_bytes;
  out.stamp = HostTime(std::chrono::seconds(buffer.timestamp.tv_sec) +
                       std::chrono::microseconds(buffer.timestamp.tv_usec));
  return out;
}

void V4l2Stream::requeue(const Buffer& given) {
  v4l2_plane plane{};
  v4l2_buffer buffer{};
  buffer.type = type_, buffer.memory = V4L2_MEMORY_MMAP, buffer.index = given.index;
  if (is_multi_planar(type_)) buffer.m.planes = &plane, buffer.length = 1;
  device_.command(VIDIOC_QBUF, buffer, "VIDIOC_QBUF");
}

}  // namespace throwcal
