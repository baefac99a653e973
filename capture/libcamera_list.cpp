// SPDX-License-Identifier: BSD-3-Clause
#include "capture/libcamera_list.h"

#include <libcamera/camera_manager.h>
#include <libcamera/formats.h>
#include <libcamera/logging.h>
#include <libcamera/property_ids.h>
#include <linux/videodev2.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <stdexcept>

#include "capture/v4l2_device.h"
#include "capture/v4l2_stream.h"

namespace throwcal {
namespace {

/// The process' only one, as libcamera wants it: it follows what is plugged in and pulled out, on a
/// thread of its own, until the process ends.
class Manager {
 public:
  static libcamera::CameraManager& get() {
    static Manager only;
    return only.manager_;
  }

 private:
  Manager() {
    // Causes come back as errors; who wants libcamera's own words asks for them.
    if (!std::getenv("LIBCAMERA_LOG_LEVELS") && !std::getenv("LIBCAMERA_LOG_FILE"))
      libcamera::logSetTarget(libcamera::LoggingTargetNone);
    if (const int error = manager_.start())
      throw std::runtime_error(std::string("libcamera does not start: ") + std::strerror(-error));
  }
  ~Manager() { manager_.stop(); }

  libcamera::CameraManager manager_;
};

bool is_number(const std::string& text) {
  return !text.empty() && text.size() < 5 && text.find_first_not_of("0123456789") == text.npos;
}

LibcameraListing listing(libcamera::Camera& camera) {
  LibcameraListing out;
  out.id = camera.id();
  out.model = camera.properties().get(libcamera::properties::Model).value_or("");
  const auto configuration = video_configuration(camera);
  if (!configuration) {
    out.problem = "gives no video";
    return out;
  }
  const libcamera::StreamFormats& formats = configuration->at(0).formats();
  bool is_read = false;
  for (const libcamera::PixelFormat& format : formats.pixelformats()) {
    const std::uint32_t fourcc = read_fourcc(format);
    is_read |= fourcc != 0;
    out.offers.push_back({fourcc ? fourcc_text(fourcc) : format.toString(),
                          fourcc != 0,
                          {{sizes_text(formats, format), {}}}});
  }
  if (!is_read) out.problem = "gives no format that throwcal reads";
  return out;
}

}  // namespace

std::uint32_t read_fourcc(const libcamera::PixelFormat& format) {
  if (format.modifier() != 0) return 0;
  const std::uint32_t fourcc =
      format == libcamera::formats::R8 ? V4L2_PIX_FMT_GREY : format.fourcc();
  return is_read_format(fourcc) ? fourcc : 0;
}

std::string sizes_text(const libcamera::StreamFormats& formats,
                       const libcamera::PixelFormat& format) {
  const libcamera::SizeRange range = formats.range(format);
  const auto text = [](const libcamera::Size& size) { return size_text(size.width, size.height); };
  if (range.hStep != 0 && range.min != range.max) return text(range.min) + " to " + text(range.max);
  std::string out;
  for (const libcamera::Size& size : formats.sizes(format))
    out += (out.empty() ? "" : ", ") + text(size);
  return out;
}

std::unique_ptr<libcamera::CameraConfiguration> video_configuration(libcamera::Camera& camera) {
  for (const auto role : {libcamera::StreamRole::VideoRecording, libcamera::StreamRole::Viewfinder})
    if (auto out = camera.generateConfiguration({role}); out && !out->empty()) return out;
  return nullptr;
}

std::shared_ptr<libcamera::Camera> find_libcamera_camera(const std::string& which) {
  const auto cameras = Manager::get().cameras();
  if (which.empty() && cameras.size() == 1) return cameras.front();
  if (is_number(which) && std::stoul(which) < cameras.size()) return cameras[std::stoul(which)];
  std::string known;
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    if (cameras[i]->id() == which) return cameras[i];
    known += (known.empty() ? "" : ", ") + std::to_string(i) + " \"" + cameras[i]->id() + "\"";
  }
  if (known.empty())
    throw DeviceError("libcamera has no camera here; `throwcal cameras` lists what there is",
                      ENODEV);
  if (which.empty())
    throw std::runtime_error("libcamera has several cameras; expected one of " + known);
  throw DeviceError("libcamera has no camera \"" + which + "\"; expected one of " + known, ENODEV);
}

std::vector<LibcameraListing> list_libcamera_cameras() {
  std::vector<LibcameraListing> out;
  for (const auto& camera : Manager::get().cameras()) out.push_back(listing(*camera));
  return out;
}

}  // namespace throwcal
