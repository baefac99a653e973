// SPDX-License-Identifier: BSD-3-Clause
#include <cstdio>
#include <sstream>

#include "firmware/config.h"
#include "firmware/text_file.h"

namespace throwcal {
namespace {

std::string to_text(const Colour& colour) {
  char text[8];
  std::snprintf(text, sizeof text, "#%02x%02x%02x", colour[0], colour[1], colour[2]);
  return text;
}

void write_camera(std::ostream& out, const CameraDescription& camera, const CameraInput& input) {
  const CameraModel& m = camera.model;
  out << "\n[[camera]]\nname = " << quoted(camera.name) << "\nwidth_px = " << m.width_px
      << "\nheight_px = " << m.height_px
      << "\nlens = " << (m.lens == Lens::kb4 ? "\"kb4\"" : "\"radtan\"")
      << "\nfx_px = " << shortest(m.fx_px) << "\nfy_px = " << shortest(m.fy_px)
      << "\ncx_px = " << shortest(m.cx_px) << "\ncy_px = " << shortest(m.cy_px);
  if (m.skew_px != 0.0) out << "\nskew_px = " << shortest(m.skew_px);
  if (m.distortion != decltype(m.distortion){}) {
    out << "\ndistortion = [";
    const std::size_t count = m.lens == Lens::kb4 ? 4 : 5;
    for (std::size_t i = 0; i < count; ++i) out << (i ? ", " : "") << shortest(m.distortion[i]);
    out << "]";
  }
  if (m.row_time_s != 0.0) out << "\nrow_time_s = " << shortest(m.row_time_s);
  if (camera.sigma_px) out << "\nsigma_px = " << shortest(*camera.sigma_px);
  if (camera.sigma_common_px != 0.0)
    out << "\nsigma_common_px = " << shortest(camera.sigma_common_px);
  for (std::size_t i = 0; i < camera.estimate.size(); ++i)
    out << (i ? ", " : "\nestimate = [") << quoted(name_of(camera.estimate[i], m.lens));
  if (!camera.estimate.empty()) out << "]";
  if (!input.source.empty()) out << "\nsource = " << quoted(input.source);
  const DeviceWishes& device = input.device;
  if (device.frames_per_s > 0) out << "\nframes_per_s = " << shortest(device.frames_per_s);
  if (!device.fourcc.empty()) out << "\npixel_format = " << quoted(device.fourcc);
  if (!device.input.empty()) out << "\ninput = " << quoted(device.input);
  if (!device.standard.empty()) out << "\nstandard = " << quoted(device.standard);
  if (!device.model.empty()) out << "\nmodel = " << quoted(device.model);
  if (!device.serial.empty()) out << "\nserial = " << quoted(device.serial);
  const PictureWishes& picture = device.picture;
  if (picture.automatic) out << "\nautomatic = true";
  const auto number = [&](const char* key, const std::optional<double>& value) {
    if (value) out << "\n" << key << " = " << shortest(*value);
  };
  number("exposure_s", picture.exposure_s);
  number("gain", picture.gain);
  number("focus", picture.focus);
  number("white_balance_k", picture.white_balance_k);
  out << "\n";
}

void write_simulation(std::ostream& out, const SimulatedSceneSettings& s) {
  out << "\n[simulation]\nseed = " << s.seed << "\ncameras = " << s.cameras
      << "\nside_m = " << shortest(s.side_m) << "\nwidth_px = " << s.width_px
      << "\nheight_px = " << s.height_px << "\nfocal_px = " << shortest(s.focal_px)
      << "\nframes_per_s = " << shortest(s.frames_per_s)
      << "\nmax_offset_s = " << shortest(s.max_offset_s)
      << "\ndrag_per_m = " << shortest(s.drag_per_m) << "\nrow_time_s = " << shortest(s.row_time_s)
      << "\nthrow_interval_s = " << shortest(s.throw_interval_s)
      << "\nexposure_s = " << shortest(s.exposure_s) << "\n";
}

void write_can(std::ostream& out, const CanSettings& can) {
  out << "\n[can]\ninterface = " << quoted(can.interface) << "\nunit = " << can.unit
      << "\nfd = " << (can.fd ? "true" : "false") << "\n";
}

}  // namespace

std::string to_toml(const Config& config) {
  const RigDescription& rig = config.rig;
  std::ostringstream out;
  out << "[site]\ngravity_mps2 = " << shortest(rig.gravity_mps2)
      << "\n\n[ball]\ndiameter_m = " << shortest(rig.ball.diameter_m)
      << (config.ball_colour ? "\ncolor = " + quoted(to_text(*config.ball_colour)) : "")
      << "\ndrag = " << (rig.ball.estimate_drag ? "\"estimate\"" : "\"none\"")
      << "\n\n[target]\nposition_m = " << shortest(rig.target.position_m)
      << "\nrotation_rad = " << shortest(rig.target.rotation_rad)
      << "\n\n[timing]\noffsets = " << (rig.estimate_offsets ? "\"estimate\"" : "\"none\"")
      << "\n\n[daemon]\nlisten = " << quoted(to_text(config.listen)) << "\n";
  if (!config.unit.empty()) out << "unit = " << quoted(config.unit) << "\n";
  if (config.token_file) out << "token_file = " << quoted(config.token_file->string()) << "\n";
  if (config.state_dir) out << "state_dir = " << quoted(config.state_dir->string()) << "\n";
  if (config.can) write_can(out, *config.can);
  out << to_toml(config.button) << to_toml(config.light);
  out << "\n[http]\nlisten = " << quoted(config.http.listen ? to_text(*config.http.listen) : "off")
      << "\n";
  write_simulation(out, config.simulation);
  for (std::size_t i = 0; i < rig.cameras.size(); ++i)
    write_camera(out, rig.cameras[i], config.inputs[i]);
  return out.str();
}

}  // namespace throwcal
