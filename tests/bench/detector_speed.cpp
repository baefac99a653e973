// SPDX-License-Identifier: BSD-3-Clause
// What a frame costs, one core: our detector beside what it must at least do (read the picture and
// the background once: memcpy of both), beside OpenCV's usual chain, and beside MOG2; and what
// comes before it, the luma taken out of YUYV, beside cv::extractChannel. Prints a table.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <functional>
#include <map>
#include <opencv2/imgproc.hpp>
#include <opencv2/video.hpp>
#include <string>
#include <vector>

#include "capture/ball_detector.h"
#include "capture/camera_factory.h"
#include "capture/pixel_rows.h"

namespace throwcal {
namespace {

constexpr int warm_frames = 60, rounds = 9;

struct Clip {
  CameraModel model;
  double ball_diameter_m = 0.0;
  std::vector<std::vector<std::uint8_t>> pictures;
  std::vector<Frame> frames;
  std::size_t ball_from = 0;  ///< frames before show a scene at rest

  cv::Mat grey(std::size_t i) const {
    return cv::Mat(model.height_px, model.width_px, CV_8U,
                   const_cast<std::uint8_t*>(pictures[i].data()));
  }
};

/// Frames of a simulated camera: first nothing but noise, then a swing, a throw and its bounce.
Clip film(int width_px, int height_px, double focal_px) {
  SimulatedSceneSettings settings{
      .seed = 11, .width_px = width_px, .height_px = height_px, .focal_px = focal_px};
  const auto scene = std::make_shared<const SimulatedScene>(settings);
  CameraSource source;
  source.source = "simulated";
  source.model = scene->rig().cameras[0].model;
  source.scene = scene;
  source.paced = false;
  source.scene_end_s = 2.9;
  const auto camera = make_camera(source);
  camera->start();
  Clip clip{source.model, scene->rig().ball.diameter_m, {}, {}, 0};
  for (;;) {
    std::vector<std::uint8_t> slot(static_cast<std::size_t>(width_px) * height_px);
    Frame frame;
    if (camera->next(slot, frame) != Camera::Outcome::frame) break;
    clip.pictures.push_back(std::move(slot));
    frame.image.data = clip.pictures.back().data();
    clip.frames.push_back(frame);
  }
  const double first_swing_s = 0.68;  // nothing moves before
  clip.ball_from = static_cast<std::size_t>(first_swing_s * settings.frames_per_s);
  if (clip.ball_from % 2 == 0) --clip.ball_from;  // an even count would show each row the same few
  return clip;
}

double seconds_of(const std::function<void()>& work) {
  const auto began = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
}

/// The usual chain: absdiff, threshold, open, connected components with statistics.
class OpenCvChain {
 public:
  explicit OpenCvChain(const cv::Mat& background) : background_(background.clone()) {}
  int operator()(const cv::Mat& grey) {
    cv::absdiff(grey, background_, difference_);
    cv::threshold(difference_, mask_, 15, 255, cv::THRESH_BINARY);
    cv::morphologyEx(mask_, opened_, cv::MORPH_OPEN, kernel_);
    return cv::connectedComponentsWithStats(opened_, labels_, stats_, centroids_);
  }

 private:
  cv::Mat background_, difference_, mask_, opened_, labels_, stats_, centroids_;
  cv::Mat kernel_ = cv::getStructuringElement(cv::MORPH_RECT, {3, 3});
};

/// The middle of several rounds over the same frames, all contenders in turn in each.
struct Times {
  std::map<std::string, std::vector<double>> ns_per_px;
  double median(const std::string& name) {
    auto& all = ns_per_px[name];
    std::ranges::sort(all);
    return all[all.size() / 2];
  }
};

void measure(const Clip& clip, std::size_t from, std::size_t to, const char* what, Times& times,
             std::vector<double>& latencies_us) {
  BallDetector detector(clip.model, clip.ball_diameter_m);
  std::uint64_t sequence = 0;
  const auto detect = [&](std::size_t i) {
    Frame frame = clip.frames[i];
    frame.sequence = sequence++;
    frame.row0_mid_exposure = HostTime(from_seconds(static_cast<double>(sequence) / 60));
    return detector.detect(frame).sightings.size();
  };
  for (int i = 0; i < warm_frames; ++i) detect(static_cast<std::size_t>(i) % clip.ball_from);
  OpenCvChain chain(clip.grey(0));
  auto mog2 = cv::createBackgroundSubtractorMOG2(500, 16, false);
  cv::Mat mask;
  for (int i = 0; i < warm_frames; ++i)
    mog2->apply(clip.grey(static_cast<std::size_t>(i) % clip.ball_from), mask);
  const std::size_t bytes = clip.pictures[0].size();
  std::vector<std::uint8_t> copy(2 * bytes), background(clip.pictures[0]);
  const cv::Mat packed(clip.model.height_px, clip.model.width_px, CV_8UC2, cv::Scalar(90, 128));
  cv::Mat luma(packed.size(), CV_8UC1);
  const double pixels = static_cast<double>(bytes) * static_cast<double>(to - from);
  std::size_t sink = 0;
  for (int round = 0; round < rounds; ++round) {
    const auto time = [&](const std::string& name, const std::function<void(std::size_t)>& one) {
      times.ns_per_px[name].push_back(1e9 / pixels * seconds_of([&] {
                                        for (std::size_t i = from; i < to; ++i) one(i);
                                      }));
    };
    time("memcpy of picture and background", [&](std::size_t i) {
      std::memcpy(copy.data(), clip.pictures[i].data(), bytes);
      std::memcpy(copy.data() + bytes, background.data(), bytes);
      sink += copy[i] + copy[bytes + i];
    });
    time(std::string("detector, ") + what, [&](std::size_t i) {
      latencies_us.push_back(1e6 * seconds_of([&] { sink += detect(i); }));
    });
    time("OpenCV: absdiff, threshold, open, components",
         [&](std::size_t i) { sink += static_cast<std::size_t>(chain(clip.grey(i))); });
    time("OpenCV: MOG2", [&](std::size_t i) {
      mog2->apply(clip.grey(i), mask);
      sink += mask.data[0];
    });
    time("luma out of YUYV", [&](std::size_t i) {
      take_luma(packed, 0, luma);
      sink += luma.data[i];
    });
    time("OpenCV: extractChannel of YUYV", [&](std::size_t i) {
      cv::extractChannel(packed, luma, 0);
      sink += luma.data[i];
    });
    if (from > 0)  // the scene is at rest again before the next round
      for (int i = 0; i < warm_frames; ++i) detect(static_cast<std::size_t>(i) % clip.ball_from);
  }
  if (sink == 1) std::puts("");  // nothing is optimised away
}

void print(int width_px, int height_px, double focal_px) {
  const Clip clip = film(width_px, height_px, focal_px);
  Times rest, thrown;
  std::vector<double> rest_us, thrown_us;
  measure(clip, 0, clip.ball_from, "nothing moves", rest, rest_us);
  measure(clip, clip.ball_from, clip.frames.size(), "a throw", thrown, thrown_us);
  const double ours = rest.median("detector, nothing moves");
  std::printf("\n| %d x %d, one core | ns a pixel | detector at rest / it |\n|---|---|---|\n",
              width_px, height_px);
  const auto row = [&](const std::string& name, double ns) {
    std::printf("| %s | %.3f | %.2f |\n", name.c_str(), ns, ns / ours);
  };
  for (const char* name : {"memcpy of picture and background", "detector, nothing moves",
                           "OpenCV: absdiff, threshold, open, components", "OpenCV: MOG2",
                           "luma out of YUYV", "OpenCV: extractChannel of YUYV"})
    row(name, rest.median(name));
  row("detector, a throw", thrown.median("detector, a throw"));
  for (auto* all : {&rest_us, &thrown_us}) {
    std::ranges::sort(*all);
    const auto at = [&](double share) {
      return (*all)[static_cast<std::size_t>(share * static_cast<double>(all->size() - 1))];
    };
    std::printf("frame to sightings, %s: p50 %.0f us, p99 %.0f us, most %.0f us\n",
                all == &rest_us ? "nothing moves" : "a throw", at(0.5), at(0.99), at(1.0));
  }
}

}  // namespace
}  // namespace throwcal

int main() {
  cv::setNumThreads(1);
  throwcal::print(640, 480, 480);
  throwcal::print(1280, 720, 900);
}
