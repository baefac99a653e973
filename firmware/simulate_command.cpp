// SPDX-License-Identifier: BSD-3-Clause
#include <cstdio>

#include "capture/camera_factory.h"
#include "firmware/commands.h"
#include "firmware/config.h"
#include "firmware/input_error.h"
#include "firmware/progress_bar.h"
#include "firmware/simulated_recording.h"
#include "firmware/text_file.h"
#include "firmware/video_recorder.h"

namespace throwcal {
namespace {

struct SimulateOptions {
  std::string output;
  SimulatedSceneSettings scene;
  SimulatedRecordingSettings recording;
  bool unlabelled = false, video = false;
};

/// A rig file that throwcald runs as it is, with every camera simulated.
Config config_of(const SimulatedScene& scene) {
  Config config;
  config.rig = scene.rig();
  config.inputs.assign(config.rig.cameras.size(), {"simulated", {}});
  config.simulation = scene.settings();
  config.listen.host = "127.0.0.1";
  return config;
}

void record_videos(const std::shared_ptr<const SimulatedScene>& scene, double end_s,
                   const std::filesystem::path& folder) {
  const RigDescription rig = scene->rig();
  for (CameraId id = 0; id < rig.cameras.size(); ++id) {
    CameraSource source;
    source.id = id;
    source.name = rig.cameras[id].name;
    source.source = "simulated";
    source.model = rig.cameras[id].model;
    source.paced = false;
    source.scene = scene;
    source.scene_end_s = end_s;
    const auto camera = make_camera(source);
    ProgressBar bar("filming " + source.name);
    record_video(*camera, folder / (source.name + ".mkv"), [&](HostTime time) {
      bar.show((seconds(time.time_since_epoch()) + scene->time_offset_s(id)) / end_s);
    });
  }
}

int run(SimulateOptions& options) {
  const std::filesystem::path folder = options.output;
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) throw InputError(options.output + ": can't be made: " + error.message());
  options.recording.labelled = !options.unlabelled;
  const auto scene = std::make_shared<const SimulatedScene>(options.scene);
  const std::vector<SightingRow> rows = simulated_sightings(*scene, options.recording);
  write_text_file(folder / "rig.toml", to_toml(config_of(*scene)));
  write_text_file(folder / "sightings.csv", to_sightings_csv(rows, scene->rig()));
  const double end_s = end_of_recording_s(*scene, options.recording.throws);
  Json truth = truth_document(*scene, options.recording.throws);
  if (options.video) truth["frames"] = true_frames(*scene, end_s);
  write_text_file(folder / "truth.json", truth.dump(2) + "\n");
  if (options.video) record_videos(scene, end_s, folder);
  std::printf(
      "%s: rig.toml, sightings.csv (%zu rows), truth.json%s: %d cameras, %d throws, %.1f s\n",
      options.output.c_str(), rows.size(), options.video ? ", videos" : "", options.scene.cameras,
      options.recording.throws, end_s);
  return exit_accepted;
}

constexpr const char* footer = R"(Example:
  throwcal simulate --output try --throws 5 --video
  throwcal calibrate --rig try/rig.toml --sightings try/sightings.csv --output try/calibration.json
  throwcald --config try/rig.toml --state-dir try/state     (the same scene, live))";

}  // namespace

void add_simulate_command(CLI::App& app, int& status) {
  auto* command =
      app.add_subcommand("simulate", "Make a rig, its sightings, videos and the truth, to try");
  command->footer(footer);
  auto options = std::make_shared<SimulateOptions>();
  SimulatedSceneSettings& scene = options->scene;
  const auto option = [&](const char* name, auto& value, const char* help, double low,
                          double high) {
    command->add_option(name, value, help)->check(CLI::Range(low, high))->capture_default_str();
  };
  command->add_option("--output", options->output, "The folder to fill")->required();
  option("--seed", scene.seed, "Another seed, another site and other throws", 0, 1e9);
  option("--cameras", scene.cameras, "How many", 2, 8);
  option("--throws", options->recording.throws, "How many", 1, 1000);
  option("--side", scene.side_m, "Of the square they stand on [m]", 2, 20);
  option("--width", scene.width_px, "Of a picture [px]", 64, 4096);
  option("--height", scene.height_px, "Of a picture [px]", 48, 4096);
  option("--focal", scene.focal_px, "Focal length [px]", 10, 10000);
  option("--fps", scene.frames_per_s, "Frames a second", 10, 1000);
  option("--offset", scene.max_offset_s, "Clocks are off by up to this [s]", 0, 0.05);
  option("--drag", scene.drag_per_m, "Drag of the ball [1/m]", 0, 1);
  option("--row-time", scene.row_time_s, "Rolling shutter, a row [s]", 0, 1e-4);
  option("--sigma", options->recording.sigma_px, "Noise of a centroid's coordinate [px]", 0, 10);
  command->add_flag("--unlabelled", options->unlabelled,
                    "Sightings as a detector gives them: no labels, the hand, bounces, clutter");
  command->add_flag("--video", options->video,
                    "Film it too: NAME.mkv (lossless FFV1) and NAME.timestamps.txt");
  command->callback([options, &status] { status = run(*options); });
}

}  // namespace throwcal
