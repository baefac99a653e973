// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/config.h"

#include <algorithm>
#include <charconv>
#include <numbers>
#include <set>

#include "capture/quotation.h"
#include "estimator/ballistics.h"
#include "firmware/can_messages.h"
#include "firmware/text_file.h"

namespace throwcal {
namespace {

constexpr std::size_t min_cameras = 2, max_cameras = 64;
constexpr std::int64_t max_side_px = 65536;

/// What no lens, ball or place on Earth, Moon or Mars exceeds; beyond it the numbers mean nothing.
const NumberRange focal_px = between(1, 1e6);
const NumberRange pixels = between(-1e6, 1e6);
const NumberRange distortion = between(-1e6, 1e6);
const NumberRange sigma_px = between(1e-6, 100);
const NumberRange target = between(1e-9, 1e6);
constexpr double max_drag_per_m = 10;  ///< an air balloon's is 4
constexpr double max_readout_s = 0.5;

/// The tables of a rig file that are not cameras.
class TopLevel {
 public:
  TopLevel(const toml::table& document, const std::string& name)
      : document_(document), name_(name) {}

  /// [name]; an empty one where the file has none.
  TomlTable table(const std::string& key) const {
    static const toml::table none;
    const toml::node* node = document_.get(key);
    if (node && !node->is_table())
      throw InputError(name_ + ":" + std::to_string(node->source().begin.line) + ": " + key +
                       " must be a table, written [" + key + "]");
    return {node ? *node->as_table() : none, name_, "[" + key + "]"};
  }

 private:
  const toml::table& document_;
  const std::string& name_;
};

double read_site(TomlTable site, Config& config) {
  const auto gravity = site.number("gravity_mps2", between(0.1, 100, "a number of m/s^2"));
  const auto latitude = site.number("latitude_deg", between(-90, 90, "a latitude in degrees"));
  const auto altitude = site.number("altitude_m", between(-500, 9000, "a height in metres"));
  RigDescription& rig = config.rig;
  if (gravity) {
    rig.gravity_mps2 = *gravity;
    rig.gravity_source = "rig file";
  } else if (latitude) {
    rig.gravity_mps2 =
        normal_gravity_mps2(*latitude * std::numbers::pi / 180.0, altitude.value_or(0.0));
    rig.gravity_source = "latitude and altitude";
  }
  std::ranges::copy(site.unread(), std::back_inserter(config.warnings));
  return altitude.value_or(0.0);
}

void read_ball(TomlTable ball, double altitude_m, Config& config) {
  BallDescription& out = config.rig.ball;
  const auto diameter = ball.number("diameter_m", between(0.001, 5, "a number of metres"));
  const auto mass = ball.number("mass_kg", between(1e-4, 100, "a number of kilograms"));
  const auto coefficient = ball.number("drag_coefficient", between(0, 10)).value_or(0.47);
  const std::string drag =
      ball.choice("drag", {"none", "from-ball", "estimate"}).value_or("estimate");
  if (drag == "from-ball" && !diameter) ball.missing("diameter_m", "it, as drag is \"from-ball\"");
  if (drag == "from-ball" && !mass) ball.missing("mass_kg", "it, as drag is \"from-ball\"");
  out.diameter_m = diameter.value_or(out.diameter_m);
  out.estimate_drag = drag == "estimate";
  if (drag != "none" && mass)
    out.drag_per_m = sphere_drag_per_m(out.diameter_m, *mass, coefficient, altitude_m);
  if (const auto colour = ball.text("color")) {
    config.ball_colour = parse_colour(*colour);
    if (!config.ball_colour) ball.reject("color", "red, green and blue like \"#d7eb5a\"");
  }
  if (out.drag_per_m > max_drag_per_m)
    ball.reject("mass_kg", "that of a ball whose drag is 10 /m at most");
  std::ranges::copy(ball.unread(), std::back_inserter(config.warnings));
}

void read_target(TomlTable table, Config& config) {
  Target& out = config.rig.target;
  out.position_m = table.number("position_m", target).value_or(out.position_m);
  out.rotation_rad = table.number("rotation_rad", target).value_or(out.rotation_rad);
  config.target_throws =
      static_cast<int>(table.integer("throws", 1, 1000).value_or(config.target_throws));
  std::ranges::copy(table.unread(), std::back_inserter(config.warnings));
}

void read_timing(TomlTable timing, Config& config) {
  config.rig.estimate_offsets =
      timing.choice("offsets", {"estimate", "none"}).value_or("estimate") == "estimate";
  std::ranges::copy(timing.unread(), std::back_inserter(config.warnings));
}

void read_distortion(TomlTable& camera, CameraModel& model) {
  const auto given = camera.numbers("distortion", distortion);
  if (!given || given->empty()) return;
  if (model.lens == Lens::radtan && given->size() != 4 && given->size() != 5)
    camera.reject("distortion", "4 or 5 numbers (k1, k2, p1, p2, k3) for a radtan lens");
  if (model.lens == Lens::kb4 && given->size() != 4)
    camera.reject("distortion", "4 numbers (k1 to k4) for a kb4 lens");
  std::ranges::copy(*given, model.distortion.begin());
}

CameraModel read_model(TomlTable& camera) {
  CameraModel model;
  model.width_px = static_cast<int>(camera.required_integer("width_px", 1, max_side_px));
  model.height_px = static_cast<int>(camera.required_integer("height_px", 1, max_side_px));
  const auto lens = camera.choice("lens", {"radtan", "kb4"});
  if (!lens) camera.missing("lens", "\"radtan\" or \"kb4\"");
  model.lens = *lens == "kb4" ? Lens::kb4 : Lens::radtan;
  model.fx_px = camera.required_number("fx_px", focal_px);
  model.fy_px = camera.required_number("fy_px", focal_px);
  model.cx_px = camera.required_number("cx_px", pixels);
  model.cy_px = camera.required_number("cy_px", pixels);
  model.skew_px = camera.number("skew_px", pixels).value_or(0.0);
  model.row_time_s =
      camera.number("row_time_s", between(0, 0.01, "a number of seconds")).value_or(0.0);
  if (model.row_time_s * model.height_px > max_readout_s)
    camera.reject("row_time_s", "short enough for all rows to be read within half a second");
  read_distortion(camera, model);
  return model;
}

/// `estimate = ["fx_px", "k1"]`: what is only roughly known of a camera.
std::vector<Intrinsic> read_estimate(TomlTable& camera, Lens lens) {
  std::vector<Intrinsic> out;
  for (const std::string& name : camera.texts("estimate").value_or(std::vector<std::string>{})) {
    std::string known;
    std::optional<Intrinsic> found;
    for (int i = 0; i < intrinsics; ++i) {
      const auto which = static_cast<Intrinsic>(i);
      if (name_of(which, lens).empty()) continue;
      known += (known.empty() ? "" : ", ") + name_of(which, lens);
      if (name_of(which, lens) == name) found = which;
    }
    if (!found || std::ranges::find(out, *found) != out.end())
      camera.reject("estimate", "a list of some of " + known + ", each once");
    out.push_back(*found);
  }
  return out;
}

bool is_name(std::string_view text) {
  constexpr std::string_view letters =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_-";
  return !text.empty() && text.size() <= 32 && text.find_first_not_of(letters) == text.npos;
}

/// "video:clip.mkv" is beside the rig file, wherever that is read from.
std::string read_source(TomlTable& camera, const std::filesystem::path& folder) {
  const std::string source = camera.text("source").value_or("");
  constexpr std::string_view video = "video:", file = "file:", v4l2 = "v4l2:";
  if (source == "sim:") return "simulated";
  if (source.empty() || source == "simulated") return source;
  for (const std::string_view kind : {video, file})
    if (source.starts_with(kind) && source.size() > kind.size())
      return std::string(video) + (folder / source.substr(kind.size())).string();
  if (source.starts_with("libcamera:")) return source;
  if (!source.starts_with(v4l2) || source.size() == v4l2.size())
    camera.reject("source", "\"simulated\", \"video:PATH\", \"v4l2:DEVICE\" or \"libcamera:ID\"");
  return source;
}

void read_picture(TomlTable& camera, PictureWishes& picture) {
  picture.automatic = camera.boolean("automatic").value_or(false);
  picture.exposure_s = camera.number("exposure_s", between(1e-6, 1, "a number of seconds"));
  picture.gain = camera.number("gain", between(-1e6, 1e6));
  picture.focus = camera.number("focus", between(-1e6, 1e6));
  picture.white_balance_k = camera.number("white_balance_k", between(1000, 20000, "kelvin"));
  const bool is_held =
      picture.exposure_s || picture.gain || picture.focus || picture.white_balance_k;
  if (picture.automatic && is_held)
    camera.reject("automatic", "false where exposure_s, gain, focus or white_balance_k is given");
}

CameraInput read_input(TomlTable& camera, const std::filesystem::path& folder) {
  CameraInput out{read_source(camera, folder), {}};
  const bool is_v4l2 = out.source.starts_with("v4l2:");
  if (!is_v4l2 && !out.source.starts_with("libcamera:")) return out;
  DeviceWishes& device = out.device;
  device.frames_per_s = camera.number("frames_per_s", between(1, 10000)).value_or(0.0);
  device.fourcc = camera.text("pixel_format").value_or("");
  if (device.fourcc.size() > 4)
    camera.reject("pixel_format", "a code of four letters like \"YUYV\"");
  device.model = camera.text("model").value_or("");
  device.serial = camera.text("serial").value_or("");
  read_picture(camera, device.picture);
  if (!is_v4l2) return out;
  device.input = camera.text("input").value_or("");
  device.standard = camera.choice("standard", {"PAL", "NTSC", "SECAM"}).value_or("");
  return out;
}

void read_camera(const toml::table& table, const std::string& name,
                 const std::filesystem::path& folder, Config& config) {
  const std::string ordinal = "camera " + std::to_string(config.rig.cameras.size() + 1);
  TomlTable camera(table, name, ordinal + ":");
  CameraDescription out;
  const auto given = camera.text("name");
  if (!given) camera.missing("name", "1 to 32 of the letters A-Z a-z 0-9 _ -");
  if (!is_name(*given)) camera.reject("name", "1 to 32 of the letters A-Z a-z 0-9 _ -");
  out.name = *given;
  if (std::ranges::any_of(config.rig.cameras, [&](const auto& c) { return c.name == out.name; }))
    camera.reject("name", "unique among the cameras");
  camera.rename("camera \"" + out.name + "\":");
  out.model = read_model(camera);
  out.sigma_px = camera.number("sigma_px", sigma_px);
  out.sigma_common_px = camera.number("sigma_common_px", sigma_px).value_or(0.0);
  out.estimate = read_estimate(camera, out.model.lens);
  config.inputs.push_back(read_input(camera, folder));
  config.rig.cameras.push_back(std::move(out));
  std::ranges::copy(camera.unread(), std::back_inserter(config.warnings));
}

void read_cameras(const toml::table& document, const std::string& name,
                  const std::filesystem::path& folder, Config& config) {
  const toml::node* node = document.get("camera");
  const toml::array* list = node ? node->as_array() : nullptr;
  const std::string expected =
      std::to_string(min_cameras) + " to " + std::to_string(max_cameras) + " [[camera]] tables";
  if (node && (!list || !list->is_homogeneous(toml::node_type::table)))
    throw InputError(name + ":" + std::to_string(node->source().begin.line) +
                     ": camera must be a list of tables, written [[camera]]");
  const std::size_t count = list ? list->size() : 0;
  if (count < min_cameras || count > max_cameras)
    throw InputError(name + ": expected " + expected + ", got " + std::to_string(count));
  for (const toml::node& camera : *list) read_camera(*camera.as_table(), name, folder, config);
}

/// Keys in a table that only the daemon reads: a misspelt one would silently do nothing.
void refuse_unread(const TomlTable& table) {
  if (const auto unread = table.unread(); !unread.empty()) throw InputError(unread.front());
}

void read_simulation(TomlTable table, SimulatedSceneSettings& s) {
  const auto number = [&](std::string_view key, double& out, const NumberRange& range) {
    out = table.number(key, range).value_or(out);
  };
  const auto integer = [&](std::string_view key, int& out, int low, int high) {
    out = static_cast<int>(table.integer(key, low, high).value_or(out));
  };
  s.seed = static_cast<std::uint64_t>(
      table.integer("seed", 0, 1'000'000'000).value_or(static_cast<std::int64_t>(s.seed)));
  integer("cameras", s.cameras, 2, 8);
  integer("width_px", s.width_px, 64, 4096);
  integer("height_px", s.height_px, 48, 4096);
  number("side_m", s.side_m, between(2.0, 20.0, "a number of metres"));
  number("focal_px", s.focal_px, between(10, 10000));
  number("frames_per_s", s.frames_per_s, between(10, 1000));
  number("max_offset_s", s.max_offset_s, between(0, 0.05, "a number of seconds"));
  number("drag_per_m", s.drag_per_m, between(0, 1));
  number("row_time_s", s.row_time_s, between(0, 1e-4, "a number of seconds"));
  number("throw_interval_s", s.throw_interval_s, between(2.0, 60.0, "a number of seconds"));
  number("exposure_s", s.exposure_s, between(0, 0.02, "a number of seconds"));
  refuse_unread(table);
}

/// `listen = ""` or "off": no HTTP.
void read_http(TomlTable table, HttpSettings& http) {
  if (const auto listen = table.text("listen")) {
    const bool is_off = listen->empty() || *listen == "off";
    http.listen = is_off ? std::nullopt : parse_address(*listen, http.listen->port);
    if (!is_off && !http.listen) table.reject("listen", "\"ADDRESS\", \"ADDRESS:PORT\" or \"off\"");
  }
  refuse_unread(table);
}

void read_daemon(TomlTable table, const std::filesystem::path& folder, Config& config) {
  if (const auto listen = table.text("listen")) {
    const auto address = parse_address(*listen, config.listen.port);
    if (!address) table.reject("listen", "\"ADDRESS\" or \"ADDRESS:PORT\"");
    config.listen = *address;
  }
  if (const auto state_dir = table.text("state_dir")) config.state_dir = folder / *state_dir;
  if (const auto token = table.text("token_file")) config.token_file = folder / *token;
  config.unit = table.text("unit").value_or("");
  if (const auto s = table.number("pre_trigger_s", between(0, 60, "a number of seconds")))
    config.pre_trigger = from_seconds(*s);
  config.keep_evidence = table.boolean("evidence").value_or(config.keep_evidence);
  if (const auto mb = table.number("keep_free_mb", between(0, 1e9, "a number of megabytes")))
    config.keep_free_bytes = static_cast<std::uint64_t>(1e6 * *mb);
  if (const auto mb = table.number("frame_memory_mb", between(1, 1e6, "a number of megabytes")))
    config.frame_memory_bytes = static_cast<std::size_t>(1e6 * *mb);
  refuse_unread(table);
}

/// What the kernel takes as a name (IFNAMSIZ).
bool is_interface_name(const std::string& text) {
  return !text.empty() && text.size() <= 15 && text != "." && text != ".." &&
         std::ranges::all_of(text,
                             [](char c) { return c > ' ' && c <= '~' && c != '/' && c != ':'; });
}

void read_can(TomlTable table, Config& config) {
  CanSettings can;
  can.interface = table.text("interface").value_or("");
  if (table.has("interface") && !is_interface_name(can.interface))
    table.reject("interface", "the name of a network interface like \"can0\"");
  can.unit = static_cast<int>(table.integer("unit", 0, can_units - 1).value_or(can.unit));
  can.fd = table.boolean("fd").value_or(can.fd);
  refuse_unread(table);
  if (!can.interface.empty()) config.can = can;
}

toml::table parse(std::string_view toml, const std::string& name) {
  try {
    return toml::parse(toml, name);
  } catch (const toml::parse_error& error) {
    throw InputError(name + ":" + std::to_string(error.source().begin.line) +
                     ": not TOML: " + printable(error.description(), 200));
  }
}

void warn_of_unknown_tables(const toml::table& document, const std::string& name, Config& config) {
  static const std::set<std::string_view> known{"site",   "ball",       "target", "timing",
                                                "camera", "simulation", "daemon", "can",
                                                "button", "light",      "http"};
  for (const auto& [key, node] : document)
    if (!known.contains(key.str()))
      config.warnings.push_back(name + ":" + std::to_string(node.source().begin.line) + ": " +
                                printable(key.str()) + " is not a known key");
}

}  // namespace

Config parse_config(std::string_view toml, const std::string& name,
                    const std::filesystem::path& folder) {
  const toml::table document = parse(toml, name);
  const TopLevel top(document, name);
  Config config;
  config.text = toml;
  warn_of_unknown_tables(document, name, config);
  const double altitude_m = read_site(top.table("site"), config);
  read_ball(top.table("ball"), altitude_m, config);
  read_target(top.table("target"), config);
  read_timing(top.table("timing"), config);
  read_cameras(document, name, folder, config);
  config.simulation.cameras = static_cast<int>(std::min<std::size_t>(config.inputs.size(), 8));
  read_simulation(top.table("simulation"), config.simulation);
  read_daemon(top.table("daemon"), folder, config);
  read_can(top.table("can"), config);
  config.button = read_button(top.table("button"));
  config.light = read_light(top.table("light"));
  read_http(top.table("http"), config.http);
  return config;
}

Config read_config(const std::filesystem::path& file) {
  return parse_config(read_text_file(file), file.string(), file.parent_path());
}

std::optional<Colour> parse_colour(std::string_view text) {
  Colour colour{};
  if (text.size() != 7 || text[0] != '#') return std::nullopt;
  for (std::size_t i = 0; i < 3; ++i) {
    const char* digits = text.data() + 1 + 2 * i;
    const auto [end, error] = std::from_chars(digits, digits + 2, colour[i], 16);
    if (error != std::errc{} || end != digits + 2) return std::nullopt;
  }
  return colour;
}

}  // namespace throwcal
