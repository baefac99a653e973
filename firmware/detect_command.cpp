// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <iterator>
#include <map>
#include <utility>

#include "firmware/cameras.h"
#include "firmware/commands.h"
#include "firmware/config.h"
#include "firmware/input_error.h"
#include "firmware/overlay.h"
#include "firmware/progress_bar.h"
#include "firmware/sightings_file.h"
#include "firmware/text_file.h"
#include "firmware/throw_search.h"
#include "firmware/videos.h"

namespace throwcal {
namespace {

struct DetectOptions {
  std::string rig, output, overlay, ball_colour;
  std::vector<std::string> videos;
  double ball_diameter_m = BallDescription{}.diameter_m;
};

/// "north=clip.mkv", or a file alone, whose stem then names the camera.
std::vector<NamedVideo> named_videos(const std::vector<std::string>& videos) {
  std::vector<NamedVideo> out;
  for (const std::string& video : videos) {
    const auto named = parse_named_video(video);
    if (named && !std::filesystem::exists(video))
      out.push_back(*named);
    else
      out.push_back({std::filesystem::path(video).stem().string(), video});
  }
  return out;
}

/// A rig of which only the videos are known.
Config config_of(const std::vector<NamedVideo>& videos, double ball_diameter_m) {
  Config config;
  config.rig.ball = {.diameter_m = ball_diameter_m, .estimate_drag = true};
  for (const NamedVideo& video : videos) config.rig.cameras.emplace_back().name = video.camera;
  return config;
}

/// What was seen, and which of it flew.
struct Detection {
  std::vector<SightingRow> rows;  ///< by camera, then time
  std::vector<std::size_t> frames, flights;
  std::size_t throws = 0;
  std::vector<std::string> warnings;
};

class Watcher {
 public:
  explicit Watcher(const RigDescription& rig)
      : rig_(rig), numbering_(rig.cameras.size()), search_(rig) {
    out_.frames.resize(rig.cameras.size());
    out_.flights.resize(rig.cameras.size());
  }

  void add(FrameSightings frame) {
    numbering_.number(frame);
    ++out_.frames[frame.camera];
    for (const BallSighting& sighting : frame.sightings) out_.rows.push_back({sighting, {}});
    keep(search_.add(frame));
  }

  /// `joined`: the lenses are known, so that flights of several cameras become throws; else each
  /// camera's flights have names of their own.
  Detection finish(bool joined) {
    keep(search_.finish());
    if (joined) label_throws();
    for (SightingRow& row : out_.rows)
      if (const auto label = labels_.find(row.sighting.id); label != labels_.end())
        row.throw_id = label->second;
    std::ranges::stable_sort(out_.rows, {}, [](const SightingRow& row) {
      return std::pair(row.sighting.camera, row.sighting.time);
    });
    return std::move(out_);
  }

 private:
  void keep(const std::vector<Track>& flights) {
    for (const Track& flight : flights) {
      const std::string number = std::to_string(++out_.flights[flight.camera]);
      for (const BallSighting& s : flight.sightings)
        labels_[s.id] = rig_.cameras[flight.camera].name + "-" + number;
    }
  }
  void label_throws() {
    labels_.clear();
    for (const Throw& thrown : search_.throws()) {
      ++out_.throws;
      for (const Track& track : thrown.tracks)
        for (const BallSighting& s : track.sightings) labels_[s.id] = thrown.id;
    }
  }

  const RigDescription& rig_;
  SightingNumbering numbering_;
  ThrowSearch search_;
  Detection out_;
  std::map<std::uint64_t, ThrowId> labels_;  ///< by sighting
};

void print_table(const Detection& found, const RigDescription& rig, bool joined) {
  std::size_t width = 6;
  for (const auto& camera : rig.cameras) width = std::max(width, camera.name.size());
  std::printf("%-*s  frames  candidates  flights  in flight  radius px  sigma px\n",
              static_cast<int>(width), "camera");
  for (CameraId id = 0; id < rig.cameras.size(); ++id) {
    std::size_t candidates = 0;
    std::vector<double> radii_px, sigmas_px;
    for (const SightingRow& row : found.rows) {
      if (row.sighting.camera != id) continue;
      ++candidates;
      if (row.throw_id.empty()) continue;
      radii_px.push_back(row.sighting.radius_px.value_or(0.0));
      sigmas_px.push_back(std::sqrt(0.5 * row.sighting.cov_px2.trace()));
    }
    const auto median = [](std::vector<double>& values) {
      if (values.empty()) return std::string("-");
      std::ranges::nth_element(values, values.begin() + std::ssize(values) / 2);
      char text[32];
      std::snprintf(text, sizeof text, "%.3f", values[values.size() / 2]);
      return std::string(text);
    };
    std::printf("%-*s  %6zu  %10zu  %7zu  %9zu  %9s  %8s\n", static_cast<int>(width),
                rig.cameras[id].name.c_str(), found.frames[id], candidates, found.flights[id],
                radii_px.size(), median(radii_px).c_str(), median(sigmas_px).c_str());
  }
  if (joined) std::printf("throws that two cameras or more saw: %zu\n", found.throws);
}

Detection watch(std::vector<std::unique_ptr<Camera>> cameras, const Config& config, bool joined) {
  Rig rig(std::move(cameras), rig_settings(config));
  rig.start();
  ProgressBar bar("watching the videos");
  Watcher watcher(config.rig);
  for (std::size_t frames = 1; auto frame = rig.next({}); ++frames) {
    bar.show_count(std::to_string(frames) + " frames");
    watcher.add(*std::move(frame));
  }
  check_ended_well(rig);
  Detection out = watcher.finish(joined);
  out.warnings = unclear_frames(rig);
  return out;
}

int run(const DetectOptions& options) {
  if (!options.overlay.empty() && !is_overlay_name(options.overlay))
    throw InputError("--overlay " + options.overlay + ": expected a name ending in .png or .mkv");
  const std::vector<NamedVideo> videos = named_videos(options.videos);
  Config config =
      options.rig.empty() ? config_of(videos, options.ball_diameter_m) : read_config(options.rig);
  if (!options.ball_colour.empty()) {
    config.ball_colour = parse_colour(options.ball_colour);
    if (!config.ball_colour)
      throw InputError("--ball-color " + options.ball_colour +
                       ": expected red, green and blue like #d7eb5a");
  }
  auto cameras = open_videos(videos, config, "");
  for (const auto& camera : cameras)
    std::ranges::find(config.rig.cameras, camera->name(), &CameraDescription::name)->model =
        camera->model();
  const bool joined = !options.rig.empty() && cameras.size() > 1;
  const Detection found = watch(std::move(cameras), config, joined);
  std::ranges::copy(found.warnings, std::back_inserter(config.warnings));
  for (const std::string& warning : config.warnings)
    std::fprintf(stderr, "throwcal: warning: %s\n", warning.c_str());
  if (!options.output.empty())
    write_text_file(options.output, to_sightings_csv(found.rows, config.rig, true));
  if (!options.overlay.empty()) {
    ProgressBar bar("drawing");
    std::size_t drawn = 0;
    draw_overlay(options.overlay, open_videos(videos, config, ""), config.rig, found.rows,
                 [&] { bar.show_count(std::to_string(++drawn) + " frames"); });
  }
  print_table(found, config.rig, joined);
  return exit_accepted;
}

constexpr const char* footer = R"(Examples:
  throwcal detect north.mkv --output sightings.csv --overlay seen.png
  throwcal detect --rig rig.toml north=clip1.mkv east=clip2.mkv --output sightings.csv --overlay seen.mkv
Output: every ball-like blob in every frame, with the ball's centre, its 1-sigma, its apparent radius and whether
it was only partly seen; `throw` names the flight it belongs to, and is empty where it belongs to none.
Without a rig file flights are told with a nominal lens: the focal length does not matter for that, strong
distortion does. With one, flights of several cameras that are one throw share its name, and those that no
other camera confirms have none. `throwcal calibrate --sightings` reads the output.)";

}  // namespace

void add_detect_command(CLI::App& app, int& status) {
  auto* command = app.add_subcommand("detect", "Find the ball, and what flew, in videos");
  auto options = std::make_shared<DetectOptions>();
  command->footer(footer);
  command->add_option("videos", options->videos, "[NAME=]PATH each; the name is a camera's")
      ->required();
  command->add_option("--output", options->output, "Where the sightings go (CSV)");
  command->add_option("--overlay", options->overlay,
                      "Draw what was seen: one picture (.png) or the film (.mkv)");
  auto* rig =
      command->add_option("--rig", options->rig, "The rig file (TOML): lenses and the ball");
  command
      ->add_option("--ball-diameter", options->ball_diameter_m,
                   "Of the ball [m], where there is no rig file")
      ->check(CLI::Range(0.001, 5.0))
      ->capture_default_str()
      ->excludes(rig);
  command->add_option("--ball-color", options->ball_colour,
                      "Of the ball, as #rrggbb: in colour videos it is told from all else by it");
  command->callback([options, &status] { status = run(*options); });
}

}  // namespace throwcal
