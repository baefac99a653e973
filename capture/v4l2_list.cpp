// SPDX-License-Identifier: BSD-3-Clause
#include "capture/v4l2_list.h"

#include <linux/videodev2.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <filesystem>
#include <functional>
#include <optional>
#include <utility>

#include "capture/camera_identity.h"
#include "capture/v4l2_device.h"
#include "capture/v4l2_stream.h"

namespace throwcal {
namespace {

std::vector<double> rates(const V4l2Device& device, std::uint32_t fourcc, std::uint32_t width,
                          std::uint32_t height) {
  std::vector<double> out;
  v4l2_frmivalenum entry{};
  entry.pixel_format = fourcc, entry.width = width, entry.height = height;
  const auto add = [&](const v4l2_fract& interval) {
    if (interval.numerator > 0)
      out.push_back(static_cast<double>(interval.denominator) / interval.numerator);
  };
  for (; device.try_command(VIDIOC_ENUM_FRAMEINTERVALS, entry); ++entry.index) {
    if (entry.type == V4L2_FRMIVAL_TYPE_DISCRETE) {
      add(entry.discrete);
      continue;
    }
    add(entry.stepwise.max), add(entry.stepwise.min);
    break;
  }
  return out;
}

std::vector<V4l2Size> sizes(const V4l2Device& device, std::uint32_t fourcc) {
  std::vector<V4l2Size> out;
  v4l2_frmsizeenum entry{};
  entry.pixel_format = fourcc;
  for (; device.try_command(VIDIOC_ENUM_FRAMESIZES, entry); ++entry.index) {
    if (entry.type == V4L2_FRMSIZE_TYPE_DISCRETE) {
      const auto& size = entry.discrete;
      out.push_back(
          {size_text(size.width, size.height), rates(device, fourcc, size.width, size.height)});
      continue;
    }
    const auto& range = entry.stepwise;
    out.push_back({size_text(range.min_width, range.min_height) + " to " +
                       size_text(range.max_width, range.max_height),
                   rates(device, fourcc, range.max_width, range.max_height)});
    break;
  }
  return out;
}

std::vector<V4l2Offer> offers(const V4l2Device& device, std::uint32_t type) {
  std::vector<V4l2Offer> out;
  v4l2_fmtdesc entry{};
  for (entry.type = type; device.try_command(VIDIOC_ENUM_FMT, entry); ++entry.index)
    out.push_back({fourcc_text(entry.pixelformat), is_read_format(entry.pixelformat),
                   sizes(device, entry.pixelformat)});
  std::ranges::stable_sort(out, std::greater<>(), &V4l2Offer::is_read);
  return out;
}

std::vector<std::string> inputs(const V4l2Device& device) {
  std::vector<std::string> out;
  v4l2_input entry{};
  for (; device.try_command(VIDIOC_ENUMINPUT, entry); ++entry.index)
    out.push_back(text_of(entry.name, sizeof entry.name));
  return out;
}

/// Nothing where the device captures no pictures.
std::optional<V4l2Listing> listing(const std::string& path) {
  V4l2Listing out;
  out.device = path;
  out.by_path = by_path(path);
  try {
    const V4l2Device device(path);
    v4l2_capability has{};
    device.command(VIDIOC_QUERYCAP, has, "VIDIOC_QUERYCAP");
    const std::uint32_t can =
        has.capabilities & V4L2_CAP_DEVICE_CAPS ? has.device_caps : has.capabilities;
    const bool is_multi_planar = can & V4L2_CAP_VIDEO_CAPTURE_MPLANE;
    if (!(can & V4L2_CAP_VIDEO_CAPTURE) && !is_multi_planar) return std::nullopt;
    out.card = text_of(has.card, sizeof has.card);
    out.driver = text_of(has.driver, sizeof has.driver);
    out.bus = text_of(has.bus_info, sizeof has.bus_info);
    out.offers = offers(
        device, is_multi_planar ? V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE : V4L2_BUF_TYPE_VIDEO_CAPTURE);
    out.inputs = inputs(device);
    const CameraIdentity identity = identity_of(device, has);
    out.model = identity.model, out.serial = identity.serial;
    out.controls = list_controls(device);
    if (out.offers.empty())
      out.problem = "offers no picture format: nothing feeds it, or its cable is off";
    else if (std::ranges::none_of(out.offers, &V4l2Offer::is_read))
      out.problem = "gives no format that throwcal reads";
    else if (!(can & V4L2_CAP_STREAMING))
      out.problem = "does not stream";
  } catch (const DeviceError& error) {
    if (error.code() == ENOTTY) return std::nullopt;
    out.problem = error.code() == EACCES
                      ? std::string("may not be opened: be root, or in the group video")
                      : std::string(error.what());
  }
  return out;
}

}  // namespace

std::string by_path(const std::filesystem::path& device, const std::filesystem::path& links) {
  std::string out;
  std::error_code error;
  for (const auto& link : std::filesystem::directory_iterator(links, error)) {
    const std::string name = link.path().string();
    const bool is_better = out.empty() || std::pair(name.size(), name) < std::pair(out.size(), out);
    if (is_better && std::filesystem::canonical(link.path(), error) == device) out = name;
  }
  return out;
}

std::vector<V4l2Listing> list_v4l2_cameras() {
  std::vector<std::pair<int, std::string>> nodes;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator("/dev", error)) {
    const std::string name = entry.path().filename().string();
    const std::string digits = name.starts_with("video") ? name.substr(5) : "";
    if (!digits.empty() && digits.size() < 5 &&
        std::ranges::all_of(digits, [](unsigned char c) { return std::isdigit(c); }))
      nodes.emplace_back(std::stoi(digits), entry.path().string());
  }
  std::ranges::sort(nodes);
  std::vector<V4l2Listing> out;
  for (const auto& [number, path] : nodes)
    if (auto found = listing(path)) out.push_back(std::move(*found));
  return out;
}

}  // namespace throwcal
