// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cstdio>
#include <iterator>
#include <utility>

#include "capture/rig.h"
#include "firmware/calibration_table.h"
#include "firmware/cameras.h"
#include "firmware/commands.h"
#include "firmware/config.h"
#include "firmware/export.h"
#include "firmware/input_error.h"
#include "firmware/progress_bar.h"
#include "firmware/session_replay.h"
#include "firmware/sightings_check.h"
#include "firmware/sightings_file.h"
#include "firmware/text_file.h"
#include "firmware/throw_search.h"
#include "firmware/videos.h"

namespace throwcal {
namespace {

struct CalibrateOptions {
  std::string rig, sightings, session, output, method = "full", guess, residuals;
  std::vector<std::string> videos;  ///< "name=path" each
  int throw_iterations = CalibrateSettings{}.throw_iterations;
  bool json = false;
};

/// What was read, and the throws in it.
struct Recording {
  std::vector<BallSighting> sightings;
  std::vector<Throw> throws;
  std::vector<std::string> warnings;
};

Recording read_sightings_recording(const Config& config, const std::string& file) {
  const std::vector<SightingRow> rows = read_sightings(file, config.rig);
  check_usable(rows, config.rig, file);
  Recording out;
  for (const SightingRow& row : rows) out.sightings.push_back(row.sighting);
  out.throws = labelled_throws(rows);
  const std::vector<FrameSightings> frames = unlabelled_frames(rows);
  if (frames.empty()) return out;
  ProgressBar bar("finding flights");
  std::size_t next = 0;
  const bool some_labelled = !out.throws.empty();
  for (Throw& found : find_throws(config.rig, [&]() -> std::optional<FrameSightings> {
         bar.show(static_cast<double>(next) / static_cast<double>(frames.size()));
         return next < frames.size() ? std::optional(frames[next++]) : std::nullopt;
       })) {
    if (some_labelled) found.id = "found-" + found.id;  // apart from the labels given
    out.throws.push_back(std::move(found));
  }
  return out;
}

std::vector<NamedVideo> named_videos(const std::vector<std::string>& options) {
  std::vector<NamedVideo> videos;
  for (const std::string& option : options) {
    const auto video = parse_named_video(option);
    if (!video)
      throw InputError("--video " + option + ": expected NAME=PATH, as in north=north.mkv");
    videos.push_back(*video);
  }
  return videos;
}

Recording read_videos(const Config& config, const std::vector<std::string>& videos) {
  auto cameras = open_videos(named_videos(videos), config, "--video ");
  if (cameras.size() < 2)
    throw InputError("--video: camera \"" + cameras.front()->name() +
                     "\" is alone; expected the videos of two cameras or more");
  Rig rig(std::move(cameras), rig_settings(config));
  rig.start();
  ProgressBar bar("watching the videos");
  Recording out;
  std::size_t frames = 0;
  SightingNumbering numbering(config.rig.cameras.size());
  out.throws = find_throws(config.rig, [&] {
    std::optional<FrameSightings> frame = rig.next({});
    bar.show_count(std::to_string(++frames) + " frames");
    if (frame) {
      numbering.number(*frame);
      std::ranges::copy(frame->sightings, std::back_inserter(out.sightings));
    }
    return frame;
  });
  check_ended_well(rig);
  out.warnings = unclear_frames(rig);
  std::ranges::sort(out.sightings, {}, [](const auto& s) { return std::pair(s.time, s.id); });
  return out;
}

CalibrateSettings settings_of(const CalibrateOptions& options, const Config& config) {
  CalibrateSettings settings;
  settings.method = parse_method(options.method).value();
  settings.throw_iterations = options.throw_iterations;
  if (!options.guess.empty())
    settings.guess = to_guess(read_json(options.guess), config.rig, options.guess);
  return settings;
}

int run(const CalibrateOptions& options) {
  Config config = read_config(options.rig);
  if (!options.videos.empty()) assume_detector_errors(config.rig);
  CalibrateSettings settings = settings_of(options, config);
  const Recording recording = options.videos.empty()
                                  ? read_sightings_recording(config, options.sightings)
                                  : read_videos(config, options.videos);
  // Of an unusable input, only the error is told.
  std::ranges::copy(recording.warnings, std::back_inserter(config.warnings));
  for (const std::string& warning : config.warnings)
    std::fprintf(stderr, "throwcal: warning: %s\n", warning.c_str());
  Calibration result;
  {
    ProgressBar bar("calibrating");
    settings.progress = [&](double fraction) { bar.show(fraction); };
    result = calibrate(config.rig, recording.throws, settings);
  }
  const std::string document = to_json(result, utc_now()).dump(2) + "\n";
  if (!options.residuals.empty())
    write_text_file(options.residuals, to_residuals_csv(recording.sightings, result));
  if (!options.output.empty()) write_text_file(options.output, document);
  std::fputs(options.json ? document.c_str() : calibration_table(result).c_str(), stdout);
  return result.verdict == Verdict::accepted ? exit_accepted : exit_not_accepted;
}

/// What a box did, once more: the same session, the same bits.
int run_session(const CalibrateOptions& options) {
  for (const std::string* other : {&options.rig, &options.guess, &options.residuals})
    if (!other->empty())
      throw InputError("calibrate --session: " + *other +
                       ": expected no --rig, --guess or --residuals, the session has its own");
  const SessionReplay replay(options.session);
  const Json document = replay.calibrate_again();
  if (!options.output.empty()) write_text_file(options.output, document.dump(2) + "\n");
  const Calibration result = to_calibration(document, options.session);
  std::fputs(options.json ? (document.dump(2) + "\n").c_str() : calibration_table(result).c_str(),
             stdout);
  std::fprintf(stderr, "throwcal: %s\n", replay.comparison(document).c_str());
  return result.verdict == Verdict::accepted ? exit_accepted : exit_not_accepted;
}

constexpr const char* footer = R"(Examples:
  throwcal calibrate --rig rig.toml --sightings sightings.csv --output calibration.json
  throwcal calibrate --rig rig.toml --video north=north.mkv --video east=east.mkv --output calibration.json
  throwcal calibrate --session 000007.throwcal --output calibration.json
Sightings: a CSV file with the header camera,time_s,u_px,v_px[,radius_px][,throw]. Rows that have no throw
label may hold anything ball-like; the flights in them are found.
Videos: frame times come from NAME.timestamps.txt beside NAME.mkv (timestamp format v2), else from the file.
A session is what the box saw and with which rig file: what is made of it again says whether it is the box's own, bit for bit.
Exit status: 0 accepted; 3 a result was written but its verdict is not accepted; 2 the input is unusable.)";

}  // namespace

void add_calibrate_command(CLI::App& app, int& status) {
  auto* command =
      app.add_subcommand("calibrate", "Calibrate a rig from sightings, videos or a box's session");
  auto options = std::make_shared<CalibrateOptions>();
  command->footer(footer);
  command->add_option("--rig", options->rig, "The rig file (TOML)");
  auto* sightings = command->add_option("--sightings", options->sightings, "The sightings (CSV)");
  auto* videos = command->add_option("--video", options->videos,
                                     "NAME=PATH: what a camera saw; once a camera");
  auto* session =
      command->add_option("--session", options->session,
                          "A box's session, of throwcal export: its calibration, made again");
  sightings->excludes(videos);
  session->excludes(videos, sightings);
  command->add_option("--output", options->output, "Where the calibration goes (JSON)");
  command->add_option("--method", options->method, "full, rb-ekf, r-ekf or ekf")
      ->check(CLI::IsMember({"full", "rb-ekf", "r-ekf", "ekf"}))
      ->capture_default_str();
  command->add_option("--throw-iterations", options->throw_iterations, "Sweeps of the filters")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  command->add_option("--guess", options->guess,
                      "A calibration file to start from in place of the closed form");
  command->add_option("--residuals", options->residuals,
                      "Where every sighting's residual goes (CSV)");
  command->add_flag("--json", options->json, "Print the calibration in place of the table");
  command->callback([options, &status] {
    if (!options->session.empty()) {
      status = run_session(*options);
      return;
    }
    if (options->rig.empty()) throw InputError("calibrate: expected --rig FILE");
    if (options->sightings.empty() && options->videos.empty())
      throw InputError(
          "calibrate: expected --sightings FILE or --video NAME=PATH, or --session FILE");
    status = run(*options);
  });
}

}  // namespace throwcal
