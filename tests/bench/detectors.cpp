// SPDX-License-Identifier: BSD-3-Clause
// detectors FOLDER...: three detectors on the same footage, against the truth. A folder holds
// rig.toml, a NAME.mkv a camera and truth.json, whose `frames` lists for each camera the frames
// with a ball: frame, u_px, v_px (its centre's projection), radius_px, is ("hand" or the flight)
// and fully_inside. Of the others' blobs the one nearest the truth counts, as if an operator had
// chosen it; ours is judged the same way.
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

#include "capture/ball_detector.h"
#include "firmware/config.h"
#include "firmware/text_file.h"

namespace throwcal {
namespace {

struct Film {
  std::vector<cv::Mat> pictures;  ///< grey
  cv::Mat mean;
  double frames_per_s = 0.0;
};

Film read_film(const std::filesystem::path& file) {
  Film film;
  cv::VideoCapture video(file.string());
  film.frames_per_s = video.get(cv::CAP_PROP_FPS);
  cv::Mat picture, sum;
  while (video.read(picture)) {
    cv::Mat grey;
    cv::cvtColor(picture, grey, cv::COLOR_BGR2GRAY);
    if (sum.empty()) sum = cv::Mat::zeros(grey.size(), CV_64F);
    cv::accumulate(grey, sum);
    film.pictures.push_back(grey);
  }
  sum.convertTo(film.mean, CV_8U, 1.0 / static_cast<double>(film.pictures.size()));
  return film;
}

/// What a detector says of one picture: centres.
using Points = std::vector<Eigen::Vector2d>;
using Detect = std::function<Points(const cv::Mat& grey, std::size_t number)>;

/// The thesis' (4.2): mean image of the clip, a fixed threshold, erosion and dilation, the mean of
/// a blob's pixels.
Points thesis(const cv::Mat& grey, const cv::Mat& mean) {
  cv::Mat difference, mask, labels, stats, centroids;
  cv::absdiff(grey, mean, difference);
  cv::threshold(difference, mask, 20, 255, cv::THRESH_BINARY);
  const cv::Mat kernel = cv::getStructuringElement(cv::MORPH_RECT, {3, 3});
  cv::erode(mask, mask, kernel);
  cv::dilate(mask, mask, kernel);
  const int count = cv::connectedComponentsWithStats(mask, labels, stats, centroids);
  Points out;
  for (int i = 1; i < count; ++i)
    out.emplace_back(centroids.at<double>(i, 0), centroids.at<double>(i, 1));
  return out;
}

/// OpenCV's, on what differs from the mean image: of the picture itself it finds mostly furniture.
Points simple_blob(const cv::Mat& grey, const cv::Mat& mean, cv::SimpleBlobDetector& detector) {
  cv::Mat difference;
  cv::absdiff(grey, mean, difference);
  std::vector<cv::KeyPoint> found;
  detector.detect(difference, found);
  Points out;
  for (const cv::KeyPoint& point : found) out.emplace_back(point.pt.x, point.pt.y);
  return out;
}

cv::Ptr<cv::SimpleBlobDetector> make_simple_blob() {
  cv::SimpleBlobDetector::Params params;
  params.blobColor = 255;
  params.minThreshold = 15, params.maxThreshold = 200, params.thresholdStep = 10;
  params.minArea = 8, params.maxArea = 6000;
  params.filterByCircularity = true, params.minCircularity = 0.6F;
  params.filterByConvexity = false, params.filterByInertia = false;
  params.minDistBetweenBlobs = 3;
  return cv::SimpleBlobDetector::create(params);
}

struct Score {
  long balls = 0, found = 0, elsewhere = 0;
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  double squares = 0.0;
};

void judge(const Film& film, const nlohmann::json& truth, const Detect& detect, Score& score) {
  std::map<std::size_t, const nlohmann::json*> balls;
  for (const auto& ball : truth) balls[ball.at("frame").get<std::size_t>()] = &ball;
  for (std::size_t n = 0; n < film.pictures.size(); ++n) {
    const Points points = detect(film.pictures[n], n);
    const auto at = balls.find(n);
    score.elsewhere += std::ssize(points);
    if (at == balls.end()) continue;
    const nlohmann::json& ball = *at->second;
    const Eigen::Vector2d centre(ball.at("u_px"), ball.at("v_px"));
    const double reach = std::max(2.0, ball.at("radius_px").get<double>());
    Eigen::Vector2d best(1e9, 1e9);
    for (const Eigen::Vector2d& point : points)
      if ((point - centre).norm() < best.norm()) best = point - centre;
    const bool is_found = best.norm() < reach;
    score.elsewhere -= is_found;
    if (ball.at("is") == "hand" || !ball.at("fully_inside").get<bool>()) continue;
    ++score.balls;
    if (!is_found) continue;
    ++score.found;
    score.sum += best;
    score.squares += best.squaredNorm();
  }
}

void compare(const std::filesystem::path& folder) {
  const Config config = read_config(folder / "rig.toml");
  const auto truth = nlohmann::json::parse(read_text_file(folder / "truth.json"));
  Score ours, whole, theses, blobs;
  const auto simple = make_simple_blob();
  for (const CameraDescription& camera : config.rig.cameras) {
    const Film film = read_film(folder / (camera.name + ".mkv"));
    const auto& balls = truth.at("frames").at(camera.name);
    for (const bool only_whole : {false, true}) {
      BallDetector detector(camera.model, config.rig.ball.diameter_m);
      const Detect detect = [&](const cv::Mat& grey, std::size_t n) {
        Frame frame;
        frame.row0_mid_exposure =
            HostTime(from_seconds(static_cast<double>(n) / film.frames_per_s));
        frame.image = {grey.data, grey.cols, grey.rows, grey.step, PixelFormat::grey};
        Points out;
        for (const BallSighting& s : detector.detect(frame).sightings)
          if (!only_whole || !s.is_partial) out.push_back(s.center_px);
        return out;
      };
      judge(film, balls, detect, only_whole ? whole : ours);
    }
    judge(
        film, balls, [&](const cv::Mat& grey, std::size_t) { return thesis(grey, film.mean); },
        theses);
    judge(
        film, balls,
        [&](const cv::Mat& grey, std::size_t) { return simple_blob(grey, film.mean, *simple); },
        blobs);
  }
  const auto row = [&](const char* name, const Score& score) {
    const double found = static_cast<double>(std::max(1L, score.found));
    std::printf(
        "| %s | %s | %ld | %.2f | %.4f | %+.4f, %+.4f | %ld |\n", folder.filename().c_str(), name,
        score.balls,
        100 * static_cast<double>(score.found) / static_cast<double>(std::max(1L, score.balls)),
        std::sqrt(score.squares / (2 * found)), score.sum.x() / found, score.sum.y() / found,
        score.elsewhere);
  };
  row("ours", ours);
  row("ours, seen whole", whole);
  row("thesis", theses);
  row("SimpleBlobDetector", blobs);
}

}  // namespace
}  // namespace throwcal

int main(int argc, char** argv) {
  std::puts(
      "| footage | detector | balls | recall % | RMS px | bias u, v px | other blobs "
      "|\n|---|---|---|---|---|---|---|");
  for (int i = 1; i < argc; ++i) throwcal::compare(argv[i]);
}
