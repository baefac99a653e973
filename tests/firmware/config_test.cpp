// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/config.h"

#include <gtest/gtest.h>

#include "estimator/ballistics.h"
#include "firmware/input_error.h"

namespace throwcal {
namespace {

const std::string north = R"([[camera]]
name = "north"
width_px = 1280
height_px = 720
lens = "radtan"
fx_px = 900.0
fy_px = 900
cx_px = 639.5
cy_px = 359.5
)";
const std::string east = R"([[camera]]
name = "east"
width_px = 640
height_px = 480
lens = "kb4"
fx_px = 300.0
fy_px = 301.0
cx_px = 320.0
cy_px = 240.0
skew_px = 0.5
distortion = [0.1, 0.2, 0.3, 0.4]
row_time_s = 1e-5
sigma_px = 0.25
sigma_common_px = 0.02
estimate = ["fx_px", "k3", "row_time_s"]
source = "video:clip.mkv"
)";

Config parsed(const std::string& toml) { return parse_config(toml, "rig.toml", "site"); }

std::string error_of(const std::string& toml) {
  try {
    parsed(toml);
  } catch (const InputError& error) {
    return error.what();
  }
  return "no error";
}

/// A rig file in which one line of camera "north" is another.
std::string north_with(const std::string& line, const std::string& in_place_of) {
  std::string text = north + east;
  return text.replace(text.find(in_place_of), in_place_of.size(), line);
}

TEST(Config, HoldsACamerasPictureAndItsIdentity) {
  const std::string device = "source = \"v4l2:/dev/video0\"\n";
  const Config config = parsed(east + north + device +
                               "model = \"Eye\"\nserial = \"0815\"\nexposure_s = 0.004\n"
                               "gain = 16\nfocus = 5\nwhite_balance_k = 4600\n");
  const DeviceWishes& north_is = config.inputs[1].device;
  EXPECT_EQ(north_is.model, "Eye");
  EXPECT_EQ(north_is.serial, "0815");
  EXPECT_EQ(north_is.picture.exposure_s, 0.004);
  EXPECT_EQ(north_is.picture.gain, 16);
  EXPECT_EQ(north_is.picture.focus, 5);
  EXPECT_EQ(north_is.picture.white_balance_k, 4600);
  EXPECT_FALSE(north_is.picture.automatic);
  EXPECT_EQ(to_toml(parse_config(to_toml(config), "back.toml")), to_toml(config));
  EXPECT_TRUE(
      parsed(east + north + device + "automatic = true\n").inputs[1].device.picture.automatic);
  EXPECT_EQ(
      error_of(east + north + device + "automatic = true\ngain = 1\n"),
      "rig.toml:27: camera \"north\": automatic must be false where exposure_s, gain, focus or "
      "white_balance_k is given, got true");
  EXPECT_EQ(error_of(east + north + device + "automatic = 1\n"),
            "rig.toml:27: camera \"north\": automatic must be true or false, got 1");
}

TEST(Config, SaysHowMuchIsKeptOfBeforeTheCapture) {
  EXPECT_EQ(parsed(north + east).pre_trigger, std::chrono::seconds(5));
  const Config config =
      parsed("[daemon]\npre_trigger_s = 0.5\nframe_memory_mb = 64\n" + north + east);
  EXPECT_EQ(config.pre_trigger, std::chrono::milliseconds(500));
  EXPECT_EQ(config.frame_memory_bytes, 64000000u);
  EXPECT_EQ(error_of("[daemon]\npre_trigger_s = 61\n" + north + east),
            "rig.toml:2: [daemon] pre_trigger_s must be a number of seconds from 0 to 60, got 61");
}

TEST(Config, ABallMayHaveAColour) {
  EXPECT_FALSE(parsed(north + east).ball_colour);
  EXPECT_EQ(parsed("[ball]\ncolor = \"#D7eb5a\"\n" + north + east).ball_colour,
            (Colour{0xd7, 0xeb, 0x5a}));
  for (const char* text : {"", "#", "d7eb5a", "#d7eb5g", "#-7eb5a", "#d7eb5a0", "# 7eb5a"})
    EXPECT_FALSE(parse_colour(text)) << text;
}

TEST(Config, ReadsEveryKeyOfACamera) {
  const Config config = parsed(north + east);
  ASSERT_EQ(config.rig.cameras.size(), 2u);
  const CameraDescription& camera = config.rig.cameras[1];
  EXPECT_EQ(camera.name, "east");
  EXPECT_EQ(camera.model.lens, Lens::kb4);
  EXPECT_EQ(camera.model.width_px, 640);
  EXPECT_EQ(camera.model.height_px, 480);
  EXPECT_EQ(camera.model.fx_px, 300.0);
  EXPECT_EQ(camera.model.fy_px, 301.0);
  EXPECT_EQ(camera.model.cx_px, 320.0);
  EXPECT_EQ(camera.model.cy_px, 240.0);
  EXPECT_EQ(camera.model.skew_px, 0.5);
  EXPECT_EQ(camera.model.distortion, (std::array<double, 5>{0.1, 0.2, 0.3, 0.4, 0.0}));
  EXPECT_EQ(camera.estimate,
            (std::vector<Intrinsic>{Intrinsic::fx, Intrinsic::d2, Intrinsic::row_time}));
  EXPECT_EQ(camera.model.row_time_s, 1e-5);
  EXPECT_EQ(camera.sigma_px, 0.25);
  EXPECT_EQ(camera.sigma_common_px, 0.02);
  EXPECT_FALSE(config.rig.cameras[0].sigma_px);
  EXPECT_EQ(config.rig.cameras[0].sigma_common_px, 0.0);
  EXPECT_EQ(config.inputs[0].source, "");
  EXPECT_EQ(config.inputs[1].source, "video:site/clip.mkv");
  EXPECT_TRUE(config.warnings.empty());
}

TEST(Config, GravityIsTheFilesOrTheLatitudesOrTheStandardOne) {
  const std::string cameras = north + east;
  EXPECT_EQ(parsed(cameras).rig.gravity_mps2, 9.80665);
  EXPECT_EQ(parsed(cameras).rig.gravity_source, "default");
  const Config given = parsed("[site]\ngravity_mps2 = 9.81\nlatitude_deg = 10\n" + cameras);
  EXPECT_EQ(given.rig.gravity_mps2, 9.81);
  EXPECT_EQ(given.rig.gravity_source, "rig file");
  const Config placed = parsed("[site]\nlatitude_deg = 45\naltitude_m = 1000\n" + cameras);
  EXPECT_NEAR(placed.rig.gravity_mps2, 9.80620 - 0.00309, 1e-4);  // free air: -3.09e-6 per metre
  EXPECT_EQ(placed.rig.gravity_source, "latitude and altitude");
}

TEST(Config, DragComesFromTheBallOrIsEstimatedOrIsNone) {
  const std::string cameras = north + east;
  const auto ball = [&](const std::string& keys) {
    return parsed("[ball]\n" + keys + "\n" + cameras).rig.ball;
  };
  const std::string tennis = "diameter_m = 0.0657\nmass_kg = 0.0577\n";
  const double expected = sphere_drag_per_m(0.0657, 0.0577, 0.5, 0.0);
  EXPECT_EQ(ball(tennis + "drag_coefficient = 0.5\ndrag = \"from-ball\"").drag_per_m, expected);
  EXPECT_FALSE(ball(tennis + "drag = \"from-ball\"").estimate_drag);
  EXPECT_TRUE(ball(tennis + "drag = \"estimate\"").estimate_drag);
  EXPECT_EQ(ball(tennis + "drag = \"none\"").drag_per_m, 0.0);
  EXPECT_FALSE(ball(tennis + "drag = \"none\"").estimate_drag);
}

TEST(Config, EveryErrorNamesFileLineKeyAndExpectation) {
  const std::string cameras = north + east;
  const struct {
    std::string toml, message;
  } cases[] = {
      {north_with("fx_px = -3", "fx_px = 900.0"),
       "rig.toml:6: camera \"north\": fx_px must be a number from 1 to 1e+06, got -3"},
      {north_with("fx_px = nan", "fx_px = 900.0"),
       "rig.toml:6: camera \"north\": fx_px must be a number from 1 to 1e+06, got nan"},
      {north_with("fx_px = \"900\"", "fx_px = 900.0"),
       "rig.toml:6: camera \"north\": fx_px must be a number from 1 to 1e+06, got \"900\""},
      {north_with("", "fx_px = 900.0"),
       "rig.toml:1: camera \"north\": fx_px is missing; expected a number from 1 to 1e+06"},
      {north_with("cx_px = inf", "cx_px = 639.5"),
       "rig.toml:8: camera \"north\": cx_px must be a number from -1e+06 to 1e+06, got inf"},
      {north_with("width_px = 12.5", "width_px = 1280"),
       "rig.toml:3: camera \"north\": width_px must be a whole number from 1 to 65536, got 12.5"},
      {north_with("lens = \"pinhole\"", "lens = \"radtan\""),
       "rig.toml:5: camera \"north\": lens must be \"radtan\" or \"kb4\", got \"pinhole\""},
      {north_with("name = \"no rth\"", "name = \"north\""),
       "rig.toml:2: camera 1: name must be 1 to 32 of the letters A-Z a-z 0-9 _ -, got \"no rth\""},
      {north_with("name = \"east\"", "name = \"north\""),
       "rig.toml:11: camera 2: name must be unique among the cameras, got \"east\""},
      {north_with("cy_px = 359.5\nestimate = [\"k4\"]", "cy_px = 359.5"),
       "rig.toml:10: camera \"north\": estimate must be a list of some of fx_px, fy_px, cx_px, "
       "cy_px, "
       "skew_px, k1, k2, p1, p2, k3, row_time_s, each once, got 1 values"},
      {north_with("cy_px = 359.5\nestimate = [1]", "cy_px = 359.5"),
       "rig.toml:10: camera \"north\": estimate must be a list of texts, got 1 values"},
      {north_with("cy_px = 359.5\ndistortion = [0.1]", "cy_px = 359.5"),
       "rig.toml:10: camera \"north\": distortion must be 4 or 5 numbers (k1, k2, p1, p2, k3) for "
       "a "
       "radtan lens, got 1 values"},
      {north_with("cy_px = 359.5\nsource = \"usb\"", "cy_px = 359.5"),
       "rig.toml:10: camera \"north\": source must be \"simulated\", \"video:PATH\", "
       "\"v4l2:DEVICE\" or \"libcamera:ID\", got "
       "\"usb\""},
      {north, "rig.toml: expected 2 to 64 [[camera]] tables, got 1"},
      {"camera = 3\n", "rig.toml:1: camera must be a list of tables, written [[camera]]"},
      {"site = 3\n" + cameras, "rig.toml:1: site must be a table, written [site]"},
      {"[site]\nlatitude_deg = 91\n" + cameras,
       "rig.toml:2: [site] latitude_deg must be a latitude in degrees from -90 to 90, got 91"},
      {"[ball]\ndrag = \"lots\"\n" + cameras,
       "rig.toml:2: [ball] drag must be \"none\", \"from-ball\" or \"estimate\", got \"lots\""},
      {"[ball]\ncolor = \"yellow\"\n" + cameras,
       "rig.toml:2: [ball] color must be red, green and blue like \"#d7eb5a\", got \"yellow\""},
      {"[ball]\ncolor = \"#d7eb5\"\n" + cameras,
       "rig.toml:2: [ball] color must be red, green and blue like \"#d7eb5a\", got \"#d7eb5\""},
      {"[ball]\ndrag = \"from-ball\"\ndiameter_m = 0.07\n" + cameras,
       "rig.toml:1: [ball] mass_kg is missing; expected it, as drag is \"from-ball\""},
      {"[target]\nposition_m = 0\n" + cameras,
       "rig.toml:2: [target] position_m must be a number from 1e-09 to 1e+06, got 0"},
      {"[timing]\noffsets = true\n" + cameras,
       "rig.toml:2: [timing] offsets must be \"estimate\" or \"none\", got true"},
      {"[daemon]\nport = 1\n" + cameras, "rig.toml:2: [daemon] port is not a known key"},
      {"[daemon]\nlisten = \":x\"\n" + cameras,
       "rig.toml:2: [daemon] listen must be \"ADDRESS\" or \"ADDRESS:PORT\", got \":x\""},
      {north_with("cy_px = 359.5\nrow_time_s = 0.001", "cy_px = 359.5"),
       "rig.toml:10: camera \"north\": row_time_s must be short enough for all rows to be read "
       "within half a second, got 0.001"},
      {north_with("cy_px = 359.5\ndistortion = [0, 0, 0, 1e300]", "cy_px = 359.5"),
       "rig.toml:10: camera \"north\": distortion must be a list, each of it a number from -1e+06 "
       "to 1e+06, got 1e+300"},
      {"[ball]\ndiameter_m = 1\nmass_kg = 0.01\n" + cameras,
       "rig.toml:3: [ball] mass_kg must be that of a ball whose drag is 10 /m at most, got 0.01"},
      {north_with("lens = \"a\\nb\"", "lens = \"radtan\""),
       "rig.toml:5: camera \"north\": lens must be \"radtan\" or \"kb4\", got \"a\\x0Ab\""},
      {"[simulation]\ncameras = 1\n" + cameras,
       "rig.toml:2: [simulation] cameras must be a whole number from 2 to 8, got 1"},
  };
  for (const auto& [toml, message] : cases) EXPECT_EQ(error_of(toml), message);
  for (const char* bad : {"[site\n", "[.site]\n", "[[.camera]]\n", "a = [\n"})
    EXPECT_TRUE(error_of(bad).starts_with("rig.toml:1: not TOML: ")) << error_of(bad);
}

TEST(Config, ALetterThatNoKeyHasIsRefused) {
  const auto utf8 = [](int code) {
    std::string out;
    if (code >= 0x800) out += static_cast<char>(0xE0 | code >> 12);
    out += static_cast<char>(code >= 0x800 ? 0x80 | (code >> 6 & 63) : 0xC0 | code >> 6);
    return out + static_cast<char>(0x80 | (code & 63));
  };
  for (int code = 0x80; code < 0x10000; ++code) {
    const std::string error = error_of(utf8(code) + " = 1\n");
    // The few blanks and ends of lines among them make a file without a key, or a key without a
    // name.
    EXPECT_TRUE(error.starts_with("rig.toml:1: not TOML: ") ||
                error.starts_with("rig.toml:2: not TOML: "))
        << code << ": " << error;
  }
}

TEST(Config, AKeyThatNobodyReadsIsAWarning) {
  const Config config =
      parsed("colour = 1\n[site]\ngravty = 3\n" + north + "exposure_s = 0.001\n" + east);
  EXPECT_EQ(config.warnings, (std::vector<std::string>{
                                 "rig.toml:1: colour is not a known key",
                                 "rig.toml:3: [site] gravty is not a known key",
                                 "rig.toml:13: camera \"north\": exposure_s is not a known key"}));
}

TEST(Config, SixtyFourCamerasAreEnough) {
  const auto rig_of = [](int count) {
    std::string toml;
    for (int i = 0; i < count; ++i) {
      std::string camera = north;
      toml += camera.replace(camera.find("north"), 5, "c" + std::to_string(i));
    }
    return toml;
  };
  EXPECT_EQ(parsed(rig_of(64)).rig.cameras.size(), 64u);
  EXPECT_EQ(error_of(rig_of(65)), "rig.toml: expected 2 to 64 [[camera]] tables, got 65");
}

TEST(Config, WhatIsWrittenIsReadBack) {
  Config config = parsed(
      "[site]\ngravity_mps2 = 9.80123\n[target]\nposition_m = 0.01\n[timing]\noffsets = \"none\"\n"
      "[daemon]\nlisten = \"[::1]:1234\"\nunit = \"box \\\"7\\\"\\n\"\n[simulation]\nseed = 9\n" +
      north + east);
  config.ball_colour = Colour{1, 0xeb, 0x5a};
  const Config back = parse_config(to_toml(config), "back.toml");
  EXPECT_EQ(to_toml(back), to_toml(config));
  EXPECT_EQ(back.rig.gravity_mps2, 9.80123);
  EXPECT_EQ(back.rig.target.position_m, 0.01);
  EXPECT_FALSE(back.rig.estimate_offsets);
  EXPECT_EQ(back.listen.host, "::1");
  EXPECT_EQ(back.listen.port, 1234);
  EXPECT_EQ(back.unit, "box \"7\"\n");
  EXPECT_EQ(back.simulation.seed, 9u);
  EXPECT_EQ(back.rig.cameras[1].sigma_common_px, 0.02);
  EXPECT_EQ(back.rig.cameras[1].model.distortion, config.rig.cameras[1].model.distortion);
  EXPECT_EQ(back.rig.cameras[1].estimate, config.rig.cameras[1].estimate);
}

TEST(Config, HasCanOnlyWhereItIsAskedFor) {
  EXPECT_FALSE(parsed(north + east).can);
  EXPECT_FALSE(parsed("[can]\nunit = 3\n" + north + east).can) << "no interface";
  const Config config =
      parsed("[can]\ninterface = \"can1\"\nunit = 11\nfd = true\n" + north + east);
  ASSERT_TRUE(config.can);
  EXPECT_EQ(config.can->interface, "can1");
  EXPECT_EQ(config.can->unit, 11);
  EXPECT_TRUE(config.can->fd);
  EXPECT_EQ(to_toml(parse_config(to_toml(config), "back.toml")), to_toml(config));
  const auto refused = [](const std::string& line) {
    return error_of("[can]\n" + line + "\n" + north + east);
  };
  EXPECT_EQ(refused("unit = 12"),
            "rig.toml:2: [can] unit must be a whole number from 0 to 11, got 12");
  for (const char* bad : {"", "a name too long!", "c/n", "c n", "..", "can0:1"})
    EXPECT_NE(refused("interface = \"" + std::string(bad) + '"')
                  .find("[can] interface must be the name of a network interface like \"can0\""),
              std::string::npos)
        << bad;
  EXPECT_EQ(refused("fd = 1"), "rig.toml:2: [can] fd must be true or false, got 1");
  EXPECT_EQ(refused("bitrate = 500"), "rig.toml:2: [can] bitrate is not a known key");
}

TEST(Config, HttpIsOnUnlessItIsSaidOtherwise) {
  EXPECT_EQ(to_text(*parsed(north + east).http.listen), "0.0.0.0:8080");
  EXPECT_EQ(to_text(*parsed("[http]\nlisten = \"[::1]\"\n" + north + east).http.listen),
            "[::1]:8080");
  for (const std::string off : {"", "off"}) {
    const Config config = parsed("[http]\nlisten = \"" + off + "\"\n" + north + east);
    EXPECT_FALSE(config.http.listen);
    EXPECT_FALSE(parse_config(to_toml(config), "back.toml").http.listen);
  }
  EXPECT_EQ(error_of("[http]\nlisten = \":80\"\n" + north + east),
            "rig.toml:2: [http] listen must be \"ADDRESS\", \"ADDRESS:PORT\" or \"off\", got "
            "\":80\"");
  EXPECT_EQ(error_of("[http]\nlitsen = \"off\"\n" + north + east),
            "rig.toml:2: [http] litsen is not a known key");
}

TEST(Address, IsAHostWithOrWithoutAPort) {
  const auto shown = [](const std::string& text) {
    const auto address = parse_address(text, 7710);
    return address ? address->host + " " + std::to_string(address->port) : "none";
  };
  EXPECT_EQ(shown("box.local"), "box.local 7710");
  EXPECT_EQ(shown("127.0.0.1:0"), "127.0.0.1 0");
  EXPECT_EQ(shown("[::1]:80"), "::1 80");
  EXPECT_EQ(shown("[::1]"), "::1 7710");
  EXPECT_EQ(shown("::1"), "::1 7710");
  for (const char* bad : {"", ":80", "box:", "box:-1", "box:65536", "box:8o", "[::1:80"})
    EXPECT_EQ(shown(bad), "none") << bad;
}

}  // namespace
}  // namespace throwcal
