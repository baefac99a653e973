// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "capture/libcamera.h"
#include "capture/v4l2_list.h"
#include "firmware/commands.h"

namespace throwcal {
namespace {

using Json = nlohmann::ordered_json;

Json known(const std::string& text) { return text.empty() ? Json() : Json(text); }

Json to_json(const std::vector<V4l2Offer>& offers) {
  Json formats = Json::array();
  for (const V4l2Offer& offer : offers) {
    Json sizes = Json::array();
    for (const V4l2Size& size : offer.sizes)
      sizes.push_back({{"size", size.text}, {"frames_per_s", size.frames_per_s}});
    formats.push_back(
        {{"pixel_format", offer.fourcc}, {"usable", offer.is_read}, {"sizes", sizes}});
  }
  return formats;
}

Json to_json(const LibcameraListing& camera) {
  return {{"source", "libcamera:" + camera.id},
          {"device", nullptr},
          {"by_path", nullptr},
          {"card", camera.model},
          {"driver", "libcamera"},
          {"bus", camera.id},
          {"model", camera.model},
          {"serial", nullptr},
          {"controls", Json::object()},
          {"inputs", Json::array()},
          {"formats", to_json(camera.offers)},
          {"problem", known(camera.problem)}};
}

Json to_json(const V4l2Listing& camera) {
  const std::string& where = camera.by_path.empty() ? camera.device : camera.by_path;
  Json controls = Json::object();
  for (const V4l2Control& c : camera.controls)
    controls[c.key] = {
        {"least", c.least}, {"most", c.most}, {"now", c.now}, {"automatic", c.is_automatic}};
  return {{"source", "v4l2:" + where},
          {"device", camera.device},
          {"by_path", known(camera.by_path)},
          {"card", camera.card},
          {"driver", camera.driver},
          {"bus", camera.bus},
          {"model", camera.model},
          {"serial", known(camera.serial)},
          {"controls", controls},
          {"inputs", camera.inputs},
          {"formats", to_json(camera.offers)},
          {"problem", known(camera.problem)}};
}

std::string rates_text(const std::vector<double>& rates) {
  if (rates.empty()) return {};
  const auto [slowest, fastest] = std::ranges::minmax(rates);
  char text[64];
  if (fastest - slowest < 0.01)
    std::snprintf(text, sizeof text, " at %.4g/s", fastest);
  else
    std::snprintf(text, sizeof text, " at %.4g to %.4g/s", slowest, fastest);
  return text;
}

void print(const std::vector<V4l2Offer>& offers) {
  std::string others;
  for (const V4l2Offer& offer : offers) {
    if (!offer.is_read) {
      others += " " + offer.fourcc;
      continue;
    }
    std::printf("  %-4s", offer.fourcc.c_str());
    for (std::size_t i = 0; i < offer.sizes.size(); ++i)
      std::printf("%s %s%s", i ? "," : "", offer.sizes[i].text.c_str(),
                  rates_text(offer.sizes[i].frames_per_s).c_str());
    std::printf("\n");
  }
  if (!others.empty()) std::printf("  not read here:%s\n", others.c_str());
}

void print(const LibcameraListing& camera) {
  std::printf("%s  %s (libcamera)\n", camera.id.c_str(), camera.model.c_str());
  std::printf("  source = \"libcamera:%s\"\n", camera.id.c_str());
  if (!camera.problem.empty()) std::printf("  PROBLEM: %s\n", camera.problem.c_str());
  print(camera.offers);
}

void print(const V4l2Listing& camera) {
  std::printf("%s  %s (%s, %s)\n", camera.device.c_str(), camera.card.c_str(),
              camera.driver.c_str(), camera.bus.c_str());
  std::printf("  source = \"v4l2:%s\"\n",
              (camera.by_path.empty() ? camera.device : camera.by_path).c_str());
  if (!camera.model.empty()) std::printf("  model = \"%s\"\n", camera.model.c_str());
  if (!camera.serial.empty()) std::printf("  serial = \"%s\"\n", camera.serial.c_str());
  if (!camera.problem.empty()) std::printf("  PROBLEM: %s\n", camera.problem.c_str());
  if (camera.inputs.size() > 1) {
    std::printf("  inputs:");
    for (const std::string& input : camera.inputs) std::printf(" \"%s\"", input.c_str());
    std::printf("\n");
  }
  for (const V4l2Control& c : camera.controls)
    std::printf("  %s from %.6g to %.6g, now %.6g%s\n", c.key.c_str(), c.least, c.most, c.now,
                c.is_automatic ? ", automatic" : "");
  print(camera.offers);
}

int list(bool as_json) {
  const std::vector<V4l2Listing> cameras = list_v4l2_cameras();
  const std::vector<LibcameraListing> others = list_libcamera_cameras();
  if (as_json) {
    Json out = Json::array();
    for (const V4l2Listing& camera : cameras) out.push_back(to_json(camera));
    for (const LibcameraListing& camera : others) out.push_back(to_json(camera));
    // A driver's name may be cut in the midst of a letter.
    std::printf("%s\n", out.dump(2, ' ', false, Json::error_handler_t::replace).c_str());
  } else {
    for (const V4l2Listing& camera : cameras) print(camera);
    for (const LibcameraListing& camera : others) print(camera);
    if (cameras.empty() && others.empty())
      std::printf(
          "no V4L2 camera is here: none plugged in, or the kernel has no driver for it (dmesg "
          "tells)\n");
  }
  const auto is_well = [](const auto& camera) { return camera.problem.empty(); };
  return std::ranges::all_of(cameras, is_well) && std::ranges::all_of(others, is_well)
             ? exit_accepted
             : exit_failed;
}

}  // namespace

void add_cameras_command(CLI::App& app, int& status) {
  auto* command = app.add_subcommand(
      "cameras", "What cameras are plugged in here, what they can do, and what is wrong");
  auto as_json = std::make_shared<bool>(false);
  command->add_flag("--json", *as_json, "For a script");
  command->footer(
      "Each `source` line is for the rig file: by the port, it stays when others come and go.\n"
      "Exit status 1 where one of them cannot be used.");
  command->callback([as_json, &status] { status = list(*as_json); });
}

}  // namespace throwcal
