// SPDX-License-Identifier: BSD-3-Clause
// grab WIDTHxHEIGHT SECONDS KEY=VALUE... CAMERA...: grabs from cameras, each CAMERA a V4L2 device
// or a whole source ("libcamera:0"), for some seconds, or until each gave frames=N, or it gets
// SIGTERM. Prints a line when a camera is lost or back, and one a camera when it ends (JSON: its
// counters). Keys: fps, format, input, standard, exposure (s), gain, serial (of the cameras after
// it), missing=1 (wait for one that is not there), colour=1, frames, times=FILE: a line a frame,
// "CAMERA SEQUENCE MID_EXPOSURE_NS TAKEN_NS EXPOSURE_NS" (taken: by a reader), and rounds=A,B,...:
// all of it again and again, until each camera gave A frames, then B ...
#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <span>
#include <sstream>
#include <string>
#include <thread>
#include <utility>

#include "capture/camera_factory.h"
#include "capture/grabber.h"

namespace throwcal {
namespace {

constexpr std::size_t ring_slots = 32;

volatile std::sig_atomic_t is_over = 0;

std::int64_t now_ns() {
  return std::chrono::steady_clock::now().time_since_epoch() / std::chrono::nanoseconds(1);
}

/// Processor time of the whole program.
std::int64_t cpu_ns() {
  timespec used{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &used);
  return used.tv_sec * 1'000'000'000LL + used.tv_nsec;
}

long resident_kb() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);)
    if (line.starts_with("VmRSS:")) return std::stol(line.substr(6));
  return 0;
}

struct Taken {
  std::uint64_t sequence;
  std::int64_t mid_exposure_ns, taken_ns, exposure_ns;
};

/// A grabber and who takes its frames.
struct Station {
  std::unique_ptr<Grabber> grabber;
  std::jthread reader;
  std::vector<Taken> taken;
  std::atomic<std::uint64_t> frames = 0;
  std::string told;
  Frame last;
  std::int64_t cpu_at_first_ns = 0;
  std::uint8_t darkest = 0, brightest = 0;  ///< in the first frame's first plane

  void read() {
    while (const auto lease = grabber->take()) {
      if (taken.empty()) cpu_at_first_ns = cpu_ns();
      last = lease->frame();
      if (taken.empty()) {
        const ImageView& image = last.image;
        const std::span plane(image.data, image.stride_bytes * image.height_px);
        darkest = *std::ranges::min_element(plane), brightest = *std::ranges::max_element(plane);
      }
      taken.push_back({last.sequence, last.row0_mid_exposure.time_since_epoch().count(), now_ns(),
                       last.exposure.count()});
      ++frames;
    }
  }
  void tell_changes() {
    const std::string error = grabber->stats().error;
    if (std::exchange(told, error) == error) return;
    std::printf("%s: %s\n", name().c_str(), error.empty() ? "is back" : error.c_str());
    std::fflush(stdout);
  }
  void report() const {
    const GrabberStats s = grabber->stats();
    const PictureSettings settings = grabber->camera().settings();
    std::printf(
        "%s\n",
        nlohmann::json{
            {"camera", name()},
            {"frames", frames.load()},
            {"lost", s.frames_lost_by_driver},
            {"damaged", s.frames_damaged},
            {"dropped", s.frames_dropped},
            {"interruptions", s.interruptions},
            {"timestamps", description(last.timestamp_source)},
            {"time_sigma_s", seconds(last.time_sigma)},
            {"exposure_s", settings.exposure_s.value_or(0.0)},
            {"gain", settings.gain.value_or(0.0)},
            {"automatic", settings.automatic},
            {"set_back", settings.set_back},
            {"is", description(grabber->camera().identity())},
            {"mode", grabber->camera().identity().mode},
            {"cpu_us_a_frame", 1e-3 * static_cast<double>(cpu_ns() - cpu_at_first_ns) /
                                   static_cast<double>(std::max<std::uint64_t>(1, frames))},
            {"levels", {darkest, brightest}},
            {"resident_kb", resident_kb()},
            {"files", std::distance(std::filesystem::directory_iterator("/proc/self/fd"), {})},
            {"error", s.error}}
            .dump()
            .c_str());
  }
  const std::string& name() const { return grabber->camera().name(); }
};

int run(int argc, char** argv, std::uint64_t enough) {
  CameraSource source;
  std::sscanf(argv[1], "%dx%d", &source.model.width_px, &source.model.height_px);
  source.model.fx_px = source.model.fy_px = source.model.width_px;
  const double most_s = std::atof(argv[2]);
  std::ofstream times;
  std::vector<std::unique_ptr<Station>> stations;
  for (int i = 3; i < argc; ++i) {
    const std::string word = argv[i];
    const std::string value = word.substr(word.find('=') + 1);
    if (word.starts_with("fps="))
      source.device.frames_per_s = std::stod(value);
    else if (word.starts_with("format="))
      source.device.fourcc = value;
    else if (word.starts_with("input="))
      source.device.input = value;
    else if (word.starts_with("standard="))
      source.device.standard = value;
    else if (word.starts_with("exposure="))
      source.device.picture.exposure_s = std::stod(value);
    else if (word.starts_with("gain="))
      source.device.picture.gain = std::stod(value);
    else if (word.starts_with("serial="))
      source.device.serial = value;
    else if (word.starts_with("missing="))
      source.may_be_missing = true;
    else if (word.starts_with("frames="))
      enough = std::stoull(value);
    else if (word.starts_with("colour="))
      source.colour = value == "1";
    else if (word.starts_with("rounds="))
      continue;
    else if (word.starts_with("times="))
      times.open(value);
    else {
      source.id = static_cast<CameraId>(stations.size());
      source.name = word;
      source.source = word.starts_with("/") ? "v4l2:" + word : word;
      stations.push_back(std::make_unique<Station>());
      stations.back()->grabber = std::make_unique<Grabber>(make_camera(source), ring_slots);
    }
  }
  for (auto& station : stations) {
    station->grabber->start();
    station->reader = std::jthread([&] { station->read(); });
  }
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(most_s);
  const auto has_enough = [&](const auto& station) { return station->frames >= enough; };
  while (!is_over && std::chrono::steady_clock::now() < end &&
         !std::ranges::all_of(stations, has_enough)) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    for (auto& station : stations) station->tell_changes();
  }
  for (auto& station : stations) {
    station->grabber->request_stop();
    station->reader.join();
    station->report();
    for (const Taken& frame : station->taken)
      times << station->name() << ' ' << frame.sequence << ' ' << frame.mid_exposure_ns << ' '
            << frame.taken_ns << ' ' << frame.exposure_ns << '\n';
  }
  return 0;
}

}  // namespace
}  // namespace throwcal

int main(int argc, char** argv) {
  if (argc < 4) return 2;
  std::signal(SIGTERM, [](int) { throwcal::is_over = 1; });
  std::stringstream rounds("");
  for (int i = 3; i < argc; ++i)
    if (const std::string word = argv[i]; word.starts_with("rounds=")) rounds.str(word.substr(7));
  try {
    std::string frames;
    if (!std::getline(rounds, frames, ',')) return throwcal::run(argc, argv, ~std::uint64_t{0});
    do throwcal::run(argc, argv, std::stoull(frames));
    while (std::getline(rounds, frames, ','));
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "grab: %s\n", error.what());
    return 1;
  }
}
