// SPDX-License-Identifier: BSD-3-Clause
#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <thread>

#include "capture/grabber.h"
#include "firmware/cameras.h"
#include "firmware/commands.h"
#include "firmware/config.h"
#include "firmware/input_error.h"
#include "firmware/progress_bar.h"
#include "firmware/video_recorder.h"

namespace throwcal {
namespace {

using namespace std::chrono_literals;

/// Frames that a slow disk may be behind.
constexpr std::size_t slack_frames = 64;
/// Of a camera that does not say how many it gives a second.
constexpr double fast_frames_per_s = 60.0;
/// A camera's first frames are still finding their exposure.
constexpr std::uint64_t frames_before_snapshot = 5;
constexpr auto snapshot_patience = 10s;

struct RecordOptions {
  std::string rig, output;
  std::vector<std::string> cameras;  ///< names; none: all
  std::vector<std::string> sources;  ///< in place of a rig file
  double seconds = 10.0;
  double before_s = 0.0;  ///< above 0: waits for Enter, and keeps that much of before it
};

/// SIGINT and SIGTERM, kept from ending the program: what was filmed is to be saved.
class StopSignals {
 public:
  StopSignals() {
    sigemptyset(&signals_);
    sigaddset(&signals_, SIGINT);
    sigaddset(&signals_, SIGTERM);
    pthread_sigmask(SIG_BLOCK, &signals_, nullptr);  // threads made later inherit it
  }
  /// Waits; true if one came.
  bool came_within(std::chrono::nanoseconds most) const {
    const timespec time{most / 1s, (most % 1s).count()};
    return sigtimedwait(&signals_, nullptr, &time) > 0;
  }

 private:
  sigset_t signals_{};
};

/// One camera at work, and who writes what it gives.
class Reel {
 public:
  Reel(std::unique_ptr<Camera> camera, std::size_t ring_slots)
      : grabber_(std::move(camera), ring_slots) {}
  ~Reel() { stop(); }

  const std::string& name() const { return grabber_.camera().name(); }
  Camera::Format format() const { return grabber_.camera().format(); }
  std::uint64_t frames() const { return frames_; }
  bool is_ended() const { return is_ended_; }
  GrabberStats stats() const { return grabber_.stats(); }

  /// `take` is told each frame, in a thread of its own; none before keep_since().
  void start(std::function<void(const Frame&)> take) {
    take_ = std::move(take);
    grabber_.start();
    writer_ = std::thread([this] {
      try {
        bool is_kept = false;
        while (const auto lease = grabber_.take()) {
          if (!has_start_) continue;
          if (!std::exchange(is_kept, true)) give_those_before(lease->frame());
          give(lease->frame());
        }
      } catch (const std::exception& error) {
        grabber_.fail(error.what());
      }
      is_ended_ = true;
    });
  }
  /// From then on, as far as the ring has it still, frames are to be taken. Thread-safe.
  void keep_since(HostTime start) {
    start_ = start;
    has_start_ = true;
  }
  void stop() {
    grabber_.request_stop();
    if (writer_.joinable()) writer_.join();
    grabber_.join();
  }

 private:
  void give(const Frame& frame) {
    take_(frame);
    ++frames_;
  }
  /// Each goes back to the ring as soon as it is written: the camera needs the room.
  void give_those_before(const Frame& frame) {
    for (FrameLease& frozen : grabber_.freeze(start_)) {
      const FrameLease lease = std::move(frozen);
      if (lease.frame().row0_mid_exposure >= frame.row0_mid_exposure) return;
      give(lease.frame());
    }
  }

  Grabber grabber_;
  std::function<void(const Frame&)> take_;
  HostTime start_{};
  std::atomic<bool> has_start_ = false;  ///< orders start_
  std::atomic<std::uint64_t> frames_ = 0;
  std::atomic<bool> is_ended_ = false;
  std::thread writer_;
};

/// Of sources: cam1, cam2, ..., as they are set.
Config config_of(const RecordOptions& options) {
  if (options.rig.empty() == options.sources.empty())
    throw InputError("expected --rig FILE, or --source v4l2:DEVICE (throwcal cameras lists them)");
  if (!options.rig.empty()) return read_config(options.rig);
  Config config;
  for (const std::string& source : options.sources) {
    if (!source.starts_with("v4l2:") && !source.starts_with("libcamera:"))
      throw InputError("--source: \"" + source +
                       "\"; expected \"v4l2:DEVICE\" or \"libcamera:ID\"");
    config.inputs.push_back({source, {}});
    config.inputs.back().device.picture.automatic = true;
    config.rig.cameras.emplace_back().name = "cam" + std::to_string(config.inputs.size());
  }
  return config;
}

std::vector<std::unique_ptr<Reel>> reels_of(const RecordOptions& options, const Config& config) {
  for (const std::string& name : options.cameras)
    if (std::ranges::none_of(config.rig.cameras, [&](const auto& c) { return c.name == name; }))
      throw InputError("--camera: \"" + name + "\" is not in the rig file");
  auto cameras = open_cameras(config);
  std::erase_if(cameras, [&](const auto& camera) {
    return !options.cameras.empty() && !std::ranges::count(options.cameras, camera->name());
  });
  std::vector<std::size_t> frames;
  for (const auto& camera : cameras) {
    const double rate = camera->format().frames_per_s;
    frames.push_back(slack_frames + static_cast<std::size_t>(std::ceil(
                                        options.before_s * (rate > 0 ? rate : fast_frames_per_s))));
  }
  check_frame_memory(config, cameras, frames);
  for (const std::string& warning : warnings_of(config, cameras))
    std::fprintf(stderr, "throwcal: %s\n", warning.c_str());
  std::vector<std::unique_ptr<Reel>> out;
  for (std::size_t i = 0; i < cameras.size(); ++i)
    out.push_back(std::make_unique<Reel>(std::move(cameras[i]), frames[i]));
  return out;
}

void make_folder(const std::string& path) {
  std::error_code error;
  std::filesystem::create_directories(path, error);
  if (error) throw InputError(path + ": can't be made: " + error.message());
}

bool all_ended(const std::vector<std::unique_ptr<Reel>>& reels) {
  return std::ranges::all_of(reels, [](const auto& reel) { return reel->is_ended(); });
}

/// Until a line or the end of standard input comes; false where a signal does.
bool wait_for_enter(const StopSignals& signals) {
  for (;;) {
    if (signals.came_within(50ms)) return false;
    pollfd input{STDIN_FILENO, POLLIN, 0};
    if (poll(&input, 1, 0) > 0) {
      char text[256];
      return read(STDIN_FILENO, text, sizeof text) >= 0;
    }
  }
}

/// What each camera gave; false where one failed.
bool report(const std::vector<std::unique_ptr<Reel>>& reels) {
  bool all_well = true;
  std::printf("%-12s %7s %7s %8s %8s\n", "camera", "frames", "lost", "damaged", "dropped");
  for (const auto& reel : reels) {
    const GrabberStats s = reel->stats();
    std::printf("%-12s %7llu %7llu %8llu %8llu\n", reel->name().c_str(),
                static_cast<unsigned long long>(reel->frames()),
                static_cast<unsigned long long>(s.frames_lost_by_driver),
                static_cast<unsigned long long>(s.frames_damaged),
                static_cast<unsigned long long>(s.frames_dropped));
    if (s.error.empty() && reel->frames() > 0) continue;
    all_well = false;
    std::fprintf(stderr, "throwcal: camera \"%s\": %s\n", reel->name().c_str(),
                 s.error.empty() ? "gave no frame" : s.error.c_str());
  }
  return all_well;
}

int record(const RecordOptions& options) {
  const StopSignals signals;
  const Config config = config_of(options);
  make_folder(options.output);
  auto reels = reels_of(options, config);
  std::vector<std::unique_ptr<VideoFile>> files;
  for (auto& reel : reels) {
    const auto path = std::filesystem::path(options.output) / (reel->name() + ".mkv");
    files.push_back(std::make_unique<VideoFile>(path, reel->format()));
  }
  for (std::size_t i = 0; i < reels.size(); ++i) {
    if (options.before_s == 0) reels[i]->keep_since(HostTime::min());
    reels[i]->start([&file = *files[i]](const Frame& frame) { file.write(frame); });
  }
  if (options.before_s > 0) {
    std::fprintf(stderr, "standing by: press Enter to keep the last %g s and film %g s more\n",
                 options.before_s, options.seconds);
    if (!wait_for_enter(signals)) return exit_failed;
    const HostTime since = host_now() - from_seconds(options.before_s);
    for (auto& reel : reels) reel->keep_since(since);
  }
  {
    ProgressBar bar("filming");
    const auto began = std::chrono::steady_clock::now();
    for (double past_s = 0; past_s < options.seconds && !all_ended(reels);) {
      if (signals.came_within(100ms)) break;
      past_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
      bar.show(past_s / options.seconds);
    }
  }
  for (auto& reel : reels) reel->stop();
  for (auto& file : files) file->close();
  const bool all_well = report(reels);
  std::printf(
      "%s: a film and its times of each; throwcal calibrate --rig %s --video NAME=FILE ...\n",
      options.output.c_str(), options.rig.empty() ? "rig.toml" : options.rig.c_str());
  return all_well ? exit_accepted : exit_failed;
}

int snapshot(const RecordOptions& options) {
  const StopSignals signals;
  const Config config = config_of(options);
  make_folder(options.output);
  auto reels = reels_of(options, config);
  std::vector<std::atomic<bool>> is_taken(reels.size());
  for (std::size_t i = 0; i < reels.size(); ++i) {
    reels[i]->keep_since(HostTime::min());
    reels[i]->start([&, i, left = frames_before_snapshot](const Frame& frame) mutable {
      if (is_taken[i] || left-- > 0) return;
      cv::Mat memory;
      const auto path = std::filesystem::path(options.output) / (reels[i]->name() + ".png");
      if (!cv::imwrite(path.string(), picture_of(frame, memory)))
        throw InputError(path.string() + ": can't be written");
      is_taken[i] = true;
    });
  }
  const auto end = std::chrono::steady_clock::now() + snapshot_patience;
  const auto is_open = [](const std::atomic<bool>& taken) { return !taken; };
  while (std::ranges::any_of(is_taken, is_open) && !all_ended(reels) &&
         std::chrono::steady_clock::now() < end && !signals.came_within(20ms)) {
  }
  for (auto& reel : reels) reel->stop();
  bool all_well = true;
  for (std::size_t i = 0; i < reels.size(); ++i) {
    const std::string error = reels[i]->stats().error;
    if (is_taken[i]) {
      std::printf("%s/%s.png\n", options.output.c_str(), reels[i]->name().c_str());
      continue;
    }
    all_well = false;
    std::fprintf(stderr, "throwcal: camera \"%s\": %s\n", reels[i]->name().c_str(),
                 error.empty() ? "gave no frame" : error.c_str());
  }
  return all_well ? exit_accepted : exit_failed;
}

CLI::App* add(CLI::App& app, const char* name, const char* help,
              const std::shared_ptr<RecordOptions>& options) {
  auto* command = app.add_subcommand(name, help);
  command->add_option("--rig", options->rig, "The rig file; its cameras' `source` keys count");
  command->add_option("--source", options->sources,
                      "Without a rig file: a camera as `throwcal cameras` names it, as it is set "
                      "(may be given again: cam1, cam2, ...)");
  command->add_option("--camera", options->cameras, "Only this one (may be given again)");
  command->add_option("--output", options->output, "The folder to fill")->required();
  return command;
}

}  // namespace

void add_record_commands(CLI::App& app, int& status) {
  auto options = std::make_shared<RecordOptions>();
  auto* film =
      add(app, "record", "Film with every camera: lossless, with each frame's time", options);
  film->add_option("--seconds", options->seconds, "How long; Ctrl-C ends it sooner and saves")
      ->check(CLI::Range(0.1, 86400.0))
      ->capture_default_str();
  film->add_option(
          "--before", options->before_s,
          "Stand by until Enter, then keep what was seen so many seconds before, too: press "
          "it after the throw")
      ->check(CLI::Range(0.0, 600.0));
  film->footer(
      "Example:\n  throwcal record --rig rig.toml --output films --seconds 30\n"
      "  throwcal calibrate --rig rig.toml --video north=films/north.mkv "
      "--video east=films/east.mkv --output calibration.json");
  film->callback([options, &status] { status = record(*options); });
  auto shot = std::make_shared<RecordOptions>();
  auto* one = add(app, "snapshot", "One picture of every camera, NAME.png", shot);
  one->footer(
      "Example:\n  throwcal snapshot --source v4l2:/dev/video0 --output pictures\n"
      "  throwcal snapshot --rig rig.toml --camera north --output pictures");
  one->callback([shot, &status] { status = snapshot(*shot); });
}

}  // namespace throwcal
